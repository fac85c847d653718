// SPDX-License-Identifier: Apache-2.0
//
// CameraModel.xml of the plenoptic line (LiFCal): lengths in mm, the principal point in pixels of
// the totally focused image, which here has the raw image's size. Its model is the paper's, with
// the micro lenses moved from their images' centres ("MicroLensCenterAdjustment").
#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>

#include "apps/formats/formats.h"
#include "calib/error.h"
#include "calib/text_file.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// Where a parameter is and how many of LiFCal's units make ours.
struct Place {
  std::string_view param;
  const char* group;  ///< element, possibly a group
  const char* child;  ///< element inside it; nullptr: none
  const char* units;
  double scale;
};
// Powers of ten divide exactly where their inverses would not.
constexpr std::array kPlaces{Place{"c_x", "PrincipalPoint", "x", "pix", 1},
                             Place{"c_y", "PrincipalPoint", "y", "pix", 1},
                             Place{"f_L", "FocalLength", nullptr, "mm", 1e3},
                             Place{"b_L0", "MainLensMlaDistance", nullptr, "mm", 1e3},
                             Place{"B", "SensorMlaDistance", nullptr, "mm", 1e3},
                             Place{"A_0", "RadialDistortion", "A0", "mm", 1e-6},
                             Place{"A_1", "RadialDistortion", "A1", "mm", 1e-12},
                             Place{"B_0", "TangentialDistortion", "B0", "mm", 1e-3},
                             Place{"B_1", "TangentialDistortion", "B1", "mm", 1e-3}};
constexpr double kMillimetres = 1e3;
constexpr std::string_view kModel = "focused-plenoptic";

std::string WriteLifcal(const std::vector<CalibratedCamera>& cameras) {
  const CalibratedCamera& camera = cameras[0];
  if (camera.model->name != kModel) {
    throw Error(ErrorKind::kJob,
                fmt::format("camera '{}': lifcal holds model {} only, not {}",
                            camera.name,
                            kModel,
                            camera.model->name));
  }
  std::string text =
      "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<Root>\n"
      "  <CalibrationModel>Plenoptic</CalibrationModel>\n";
  text += fmt::format(
      "  <ImageSize units=\"pix\">\n    <Width>{}</Width>\n    <Height>{}</Height>\n"
      "  </ImageSize>\n  <PixelSize units=\"mm\">{}</PixelSize>\n",
      camera.image_size[0],
      camera.image_size[1],
      camera.config[0] * kMillimetres);
  for (size_t i = 0; i < kPlaces.size(); ++i) {
    const Place& place = kPlaces[i];
    double value = 0;
    for (size_t p = 0; p < camera.params.size(); ++p) {
      if (camera.model->params[p].name == place.param) value = camera.params[p] * place.scale;
    }
    if (place.child == nullptr) {
      text += fmt::format("  <{0} units=\"{1}\">{2}</{0}>\n", place.group, place.units, value);
      continue;
    }
    const bool opens = i == 0 || std::string_view(kPlaces[i - 1].group) != place.group;
    const bool closes =
        i + 1 == kPlaces.size() || std::string_view(kPlaces[i + 1].group) != place.group;
    if (opens) text += fmt::format("  <{} units=\"{}\">\n", place.group, place.units);
    text += fmt::format("    <{0}>{1}</{0}>\n", place.child, value);
    if (closes) text += fmt::format("  </{}>\n", place.group);
  }
  return text + "  <MicroLensCenterAdjustment>true</MicroLensCenterAdjustment>\n</Root>\n";
}

std::vector<CalibratedCamera> ReadLifcal(const CameraSource& source) {
  const std::string text = ReadTextFile(source.path);
  const auto fail = [&](const std::string& message) {
    throw Error(ErrorKind::kInput, fmt::format("{}: {}", source.path.string(), message));
  };
  pugi::xml_document document;
  const pugi::xml_parse_result parsed = document.load_string(text.c_str());
  if (!parsed) fail(fmt::format("not valid XML: {}", parsed.description()));
  const pugi::xml_node root = document.child("Root");
  if (!root) fail("expected the element <Root> of a CameraModel.xml");
  if (std::string_view(root.child("MicroLensCenterAdjustment").child_value()) == "false") {
    fail("was calibrated without MicroLensCenterAdjustment, which is another model");
  }
  const auto number = [&](const char* group, const char* child) {
    pugi::xml_node node = root.child(group);
    if (child != nullptr) node = node.child(child);
    const std::string_view value = node.child_value();
    double result = 0;
    const auto [end, error] = std::from_chars(value.data(), value.data() + value.size(), result);
    if (error != std::errc() || end != value.data() + value.size() || !std::isfinite(result)) {
      fail(fmt::format("<{}{}{}>: expected a number, found '{}'",
                       group,
                       child == nullptr ? "" : "><",
                       child == nullptr ? "" : child,
                       value));
    }
    return result;
  };
  CalibratedCamera camera;
  camera.model = FindModel(CameraModels(), kModel);
  const double width = number("ImageSize", "Width"), height = number("ImageSize", "Height");
  if (!(width >= 1 && height >= 1 && width < 1e6 && height < 1e6)) {
    fail("<ImageSize>: expected numbers of pixels");
  }
  camera.image_size = {static_cast<int>(width), static_cast<int>(height)};
  const double pixel_mm = number("PixelSize", nullptr);
  camera.config = {
      Inverted(pixel_mm, pixel_mm / kMillimetres, [](double x) { return x * kMillimetres; })};
  for (const Param& param : camera.model->params) {
    for (const Place& place : kPlaces) {
      if (place.param != param.name) continue;
      // Distortion may be left out there.
      const pugi::xml_node group = root.child(place.group);
      const bool absent = param.neutral && (!group || !group.child(place.child));
      const double value = absent ? 0 : number(place.group, place.child);
      camera.params.push_back(
          Inverted(value, value / place.scale, [&](double x) { return x * place.scale; }));
      if (!(camera.params.back() > param.lower && camera.params.back() < param.upper)) {
        fail(fmt::format("<{}>: {} is out of bounds", place.group, value));
      }
    }
  }
  return {camera};
}

}  // namespace

CameraFormat LifcalFormat() {
  return {"lifcal", "CameraModel.xml", 1, false, WriteLifcal, ReadLifcal};
}

}  // namespace plenocal
