// SPDX-License-Identifier: Apache-2.0
//
// Calibration XML of Metashape (Agisoft): <calibration> alone, as "Export Calibration" writes it,
// or the adjusted ones of the sensors of a <document>. What is zero may be left out.
//
// Source: Agisoft Metashape User Manual, Professional Edition 1.5, appendix C ("Camera models");
// the elements as in ezwelty/glimpse, tests/agisoft.xml. With (x, y) the plane point of the
// projection, q = x^2 + y^2, and the centre of the first pixel at (0.5, 0.5):
//
//   x' = x (1 + k1 q + k2 q^2 + k3 q^3 + k4 q^4) + p1 (q + 2 x^2) + 2 p2 x y
//   y' = y (1 + ...) + p2 (q + 2 y^2) + 2 p1 x y
//   u = width / 2 + cx + x' f + x' b1 + y' b2,   v = height / 2 + cy + y' f
//
// p3 and p4, factors of the tangential terms, are not read.
#include <fmt/format.h>

#include <array>
#include <numbers>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "engine/formats/lens_form.h"
#include "engine/formats/xml_file.h"

namespace plenocal {
namespace {

constexpr double kMetashapePixel = 0.5;
/// Elements of the coefficients; the last is b2 / f_x here.
constexpr std::array kElements{"k1", "k2", "k3", "k4", "p1", "p2", "b2"};

const LensTable& MetashapeLenses() {
  static const LensTable kTable{
      .tool = "metashape",
      .forms = {{"pinhole", "frame", "0 0 0 0 0 0 0"},
                {"pinhole-radial3", "frame", "A_0 A_1 A_2 0 0 0 0"},
                {"pinhole-radtan4", "frame", "k_1 k_2 0 0 p_2 p_1 0"},
                {"pinhole-radtan", "frame", "k_1 k_2 k_3 0 p_2 p_1 0"},
                {"pinhole+brown", "frame", "k_1 k_2 k_3 k_4 p_2 p_1 0"},
                {"pinhole+skew", "frame", "0 0 0 0 0 0 alpha_s"},
                {"pinhole-radial3+skew", "frame", "A_0 A_1 A_2 0 0 0 alpha_s"},
                {"pinhole-radtan+skew", "frame", "k_1 k_2 k_3 0 p_2 p_1 alpha_s"},
                {"pinhole+brown+skew", "frame", "k_1 k_2 k_3 k_4 p_2 p_1 alpha_s"},
                {"equidistant", "fisheye", "0 0 0 0 0 0 0"},
                {"kannala-brandt4", "fisheye", "k_1 k_2 k_3 k_4 0 0 0"},
                {"equidistant+brown", "fisheye", "k_1 k_2 k_3 k_4 p_2 p_1 0"},
                {"equidistant+brown+skew", "fisheye", "k_1 k_2 k_3 k_4 p_2 p_1 alpha_s"},
                {"equisolid", "equisolid_fisheye", "0 0 0 0 0 0 0"},
                {"equisolid+radial4", "equisolid_fisheye", "k_1 k_2 k_3 k_4 0 0 0"},
                {"equisolid+brown", "equisolid_fisheye", "k_1 k_2 k_3 k_4 p_2 p_1 0"},
                {"equisolid+brown+skew", "equisolid_fisheye", "k_1 k_2 k_3 k_4 p_2 p_1 alpha_s"}},
      .first_pixel = kMetashapePixel};
  return kTable;
}

/// Of a spherical image, whose parameters Metashape takes from its width.
std::array<double, 4> MetashapePanorama(ImageSize size) {
  const double f = size[0] / (2 * std::numbers::pi);
  return {f, f, size[0] / 2.0 - kMetashapePixel, size[1] / 2.0 - kMetashapePixel};
}

std::string WriteMetashape(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  Lens lens{"spherical", camera.params[0], camera.params[0], 0, 0, {}};
  std::string numbers;
  const auto add = [&](const char* element, double value) {
    numbers += fmt::format("  <{0}>{1}</{0}>\n", element, RealText(value));
  };
  if (camera.model->name == "spherical") {
    CheckPanorama(camera, MetashapePanorama(camera.image_size), "metashape");
    add("f", lens.f_y);
  } else {
    lens = ToLens(camera, MetashapeLenses());
    add("f", lens.f_y);
    add("cx", lens.c_x - camera.image_size[0] / 2.0);
    add("cy", lens.c_y - camera.image_size[1] / 2.0);
    add("b1", lens.f_x - lens.f_y);
    lens.coefficients.back() *= lens.f_x;  // the skew
    for (size_t i = 0; i < kElements.size(); ++i) add(kElements[i], lens.coefficients[i]);
  }
  return fmt::format(
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<calibration>\n"
      "  <projection>{}</projection>\n  <width>{}</width>\n  <height>{}</height>\n{}"
      "</calibration>\n",
      lens.name,
      camera.image_size[0],
      camera.image_size[1],
      numbers);
}

CalibratedCamera ReadCalibration(const XmlFile& xml,
                                 const pugi::xml_node& node,
                                 const std::string& file) {
  const auto number = [&](const char* element) {
    const pugi::xml_node child = node.child(element);
    return child ? xml.Number(child.child_value(), fmt::format("<{}>", element)) : 0;
  };
  const auto pixels = [&](const char* side) {
    const pugi::xml_attribute attribute = node.child("resolution").attribute(side);
    return xml.Pixels(attribute ? attribute.value() : node.child(side).child_value(),
                      fmt::format("<{}>", side));
  };
  const ImageSize size{pixels("width"), pixels("height")};
  const pugi::xml_attribute type = node.attribute("type");
  std::string projection = type ? type.value() : node.child("projection").child_value();
  if (projection == "spherical") return PanoramaCamera(size, MetashapePanorama(size));
  if (projection == "equidistant_fisheye") projection = "fisheye";  // since Metashape 2.3
  for (const char* element : {"p3", "p4"}) {
    if (number(element) == 0) continue;
    xml.Fail(
        fmt::format("<{}>: is not read; optimize the cameras in Metashape without it", element));
  }
  if (!node.child("f")) xml.Fail("<calibration>: expected the focal length <f>");
  const double f = number("f");
  Lens lens{projection,
            f + number("b1"),
            f,
            size[0] / 2.0 + number("cx"),
            size[1] / 2.0 + number("cy"),
            {}};
  for (const char* element : kElements) lens.coefficients.push_back(number(element));
  lens.coefficients.back() /= lens.f_x;
  return FromLens(lens, size, MetashapeLenses(), file);
}

std::vector<CalibratedCamera> ReadMetashape(const CameraSource& source) {
  const XmlFile xml(source.path);
  std::vector<CalibratedCamera> cameras;
  if (const pugi::xml_node alone = xml.Document().child("calibration")) {
    return {ReadCalibration(xml, alone, source.path.string())};
  }
  for (const pugi::xpath_node& sensor : xml.Document().select_nodes("//sensor")) {
    for (const pugi::xml_node& node : sensor.node().children("calibration")) {
      if (std::string_view(node.attribute("class").value()) == "initial") continue;
      cameras.push_back(ReadCalibration(xml, node, source.path.string()));
      cameras.back().name = fmt::format("sensor{}", sensor.node().attribute("id").value());
    }
  }
  if (cameras.empty()) xml.Fail("expected the element <calibration>");
  return cameras;
}

}  // namespace

CameraFormat MetashapeFormat() {
  return {.name = "metashape",
          .file = "calibration.xml",
          .write = WriteMetashape,
          .read = ReadMetashape};
}

}  // namespace plenocal
