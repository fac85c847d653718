// SPDX-License-Identifier: Apache-2.0
#include "calib/camera_yaml.h"

#include <fmt/format.h>

#include "calib/error.h"
#include "calib/names.h"

namespace plenocal {

const CameraModel* ReadModel(const YamlNode& node, std::span<const CameraModel> models) {
  const std::string name = node.AsString();
  if (const CameraModel* model = FindModel(models, name)) return model;
  node.Fail(fmt::format("unknown camera model '{}'{} (a model from outside needs --plugin FILE)",
                        name,
                        SuggestName(name, NamesOf(models))));
}

ImageSize ReadImageSize(const YamlNode& node) {
  const std::vector<YamlNode> elements = node.Elements();
  if (elements.size() != 2) node.Fail("expected [width, height]");
  ImageSize size{};
  for (size_t i = 0; i < 2; ++i) {
    size[i] = elements[i].AsInteger();
    if (size[i] < 1) elements[i].Fail("expected a positive number of pixels");
  }
  return size;
}

double ReadWithin(const YamlNode& node, const Param& param) {
  const double value = node.AsNumber();
  if (!(value > param.lower && value < param.upper)) {
    node.Fail(fmt::format(
        "{} = {} {} is outside ({}, {})", param.name, value, param.unit, param.lower, param.upper));
  }
  return value;
}

}  // namespace plenocal
