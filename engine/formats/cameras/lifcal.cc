// SPDX-License-Identifier: Apache-2.0
//
// CameraModel.xml of the plenoptic line (LiFCal): lengths in mm, the principal point in pixels of
// the totally focused image, which here has the raw image's size. Its model is the paper's, with
// the micro lenses moved from their images' centres ("MicroLensCenterAdjustment").
#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "calib/base/format_error.h"
#include "engine/formats/camera_format.h"
#include "engine/formats/xml_file.h"
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

/// The elements of a CameraModel.xml.
class ModelXml : public XmlFile {
 public:
  explicit ModelXml(const std::filesystem::path& path)
      : XmlFile(path), root_(Document().child("Root")) {
    if (!root_) Fail("expected the element <Root> of a CameraModel.xml");
  }

  [[nodiscard]] bool Has(const char* group, const char* child) const {
    return root_.child(group).child(child);
  }

  [[nodiscard]] std::string_view Text(const char* group, const char* child = nullptr) const {
    const pugi::xml_node node = root_.child(group);
    return (child == nullptr ? node : node.child(child)).child_value();
  }

  [[nodiscard]] double ReadNumber(const char* group, const char* child = nullptr) const {
    return Number(
        Text(group, child),
        child == nullptr ? fmt::format("<{}>", group) : fmt::format("<{}><{}>", group, child));
  }

 private:
  pugi::xml_node root_;
};

double ReadParam(const ModelXml& xml, const Param& param) {
  const Place& place = *std::ranges::find(kPlaces, param.name, &Place::param);
  // Distortion may be left out there.
  const bool absent = param.neutral && !xml.Has(place.group, place.child);
  const double given = absent ? 0 : xml.ReadNumber(place.group, place.child);
  const double value = given / place.scale;
  if (!(value > param.lower && value < param.upper)) {
    xml.Fail(fmt::format("<{}>: {} is out of bounds", place.group, given));
  }
  return value;
}

std::vector<CalibratedCamera> ReadLifcal(const CameraSource& source) {
  const ModelXml xml(source.path);
  if (xml.Text("MicroLensCenterAdjustment") == "false") {
    xml.Fail("was calibrated without MicroLensCenterAdjustment, which is another model");
  }
  CalibratedCamera camera;
  camera.model = FindModel(CameraModels(), kModel);
  const auto pixels = [&](const char* side) {
    return xml.Pixels(xml.Text("ImageSize", side), fmt::format("<ImageSize><{}>", side));
  };
  camera.image_size = {pixels("Width"), pixels("Height")};
  camera.config = {xml.ReadNumber("PixelSize") / kMillimetres};
  for (const Param& param : camera.model->params) camera.params.push_back(ReadParam(xml, param));
  return {camera};
}

}  // namespace

CameraFormat LifcalFormat() {
  return {.name = "lifcal", .file = "CameraModel.xml", .write = WriteLifcal, .read = ReadLifcal};
}

}  // namespace plenocal
