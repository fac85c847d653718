// SPDX-License-Identifier: Apache-2.0
//
// CameraModel.xml of the plenoptic line (LiFCal): lengths in mm, the principal point in pixels of
// the totally focused image, which here has the raw image's size. Its model is the paper's, with
// the micro lenses moved from their images' centres ("MicroLensCenterAdjustment").
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <pugixml.hpp>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/exact_numbers.h"
#include "models/registry.h"

namespace plenocal {
namespace {

/// The element of a parameter, and the factor from our unit to LiFCal's.
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
    throw JobError(
        "camera '{}': lifcal holds model {} only, not {}", camera.name, kModel, camera.model->name);
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

/// The elements of a CameraModel.xml; all members throw `Error` of kind kInput with the file.
class ModelXml {
 public:
  explicit ModelXml(const std::filesystem::path& path) : where_(path.string()) {
    const pugi::xml_parse_result parsed =
        document_.load_string(ReadTextFile(path, InputLimit::kDocument).c_str());
    if (!parsed) Fail(fmt::format("not valid XML: {}", parsed.description()));
    root_ = document_.child("Root");
    if (!root_) Fail("expected the element <Root> of a CameraModel.xml");
  }

  [[nodiscard]] bool Has(const char* group, const char* child) const {
    return root_.child(group).child(child);
  }

  [[nodiscard]] std::string_view Text(const char* group, const char* child = nullptr) const {
    const pugi::xml_node node = root_.child(group);
    return (child == nullptr ? node : node.child(child)).child_value();
  }

  [[nodiscard]] double Number(const char* group, const char* child = nullptr) const {
    const std::string_view text = Text(group, child);
    double value = 0;
    const char* const end = text.data() + text.size();
    const auto [after, error] = std::from_chars(text.data(), end, value);
    if (error != std::errc() || after != end || !std::isfinite(value)) {
      Fail(fmt::format("<{}{}{}>: expected a number, found '{}'",
                       group,
                       child == nullptr ? "" : "><",
                       child == nullptr ? "" : child,
                       text));
    }
    return value;
  }

  [[noreturn]] void Fail(const std::string& message) const {
    throw InputError("{}: {}", where_, message);
  }

 private:
  std::string where_;
  pugi::xml_document document_;
  pugi::xml_node root_;
};

double ReadParam(const ModelXml& xml, const Param& param) {
  const Place& place = *std::ranges::find(kPlaces, param.name, &Place::param);
  // Distortion may be left out there.
  const bool absent = param.neutral && !xml.Has(place.group, place.child);
  const double given = absent ? 0 : xml.Number(place.group, place.child);
  const double value =
      Inverted(given, given / place.scale, [&](double x) { return x * place.scale; });
  if (!(value > param.lower && value < param.upper)) {
    xml.Fail(fmt::format("<{}>: {} is out of bounds", place.group, given));
  }
  return value;
}

std::vector<CalibratedCamera> ReadLifcal(const CameraSource& source) {
  constexpr double kMost = 1e6;  // no image has more pixels in a row
  const ModelXml xml(source.path);
  if (xml.Text("MicroLensCenterAdjustment") == "false") {
    xml.Fail("was calibrated without MicroLensCenterAdjustment, which is another model");
  }
  CalibratedCamera camera;
  camera.model = FindModel(CameraModels(), kModel);
  const double width = xml.Number("ImageSize", "Width"), height = xml.Number("ImageSize", "Height");
  if (!(width >= 1 && height >= 1 && width < kMost && height < kMost)) {
    xml.Fail("<ImageSize>: expected numbers of pixels");
  }
  camera.image_size = {static_cast<int>(width), static_cast<int>(height)};
  const double pixel_mm = xml.Number("PixelSize");
  camera.config = {
      Inverted(pixel_mm, pixel_mm / kMillimetres, [](double x) { return x * kMillimetres; })};
  for (const Param& param : camera.model->params) camera.params.push_back(ReadParam(xml, param));
  return {camera};
}

}  // namespace

CameraFormat LifcalFormat() {
  return {.name = "lifcal", .file = "CameraModel.xml", .write = WriteLifcal, .read = ReadLifcal};
}

}  // namespace plenocal
