// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/try_json.h"

#include <string>

#include "apps/workbench/project/beneath.h"
#include "calib/io/yaml.h"

namespace plenocal::workbench {
namespace {

using Json = nlohmann::json;
constexpr size_t kMostTry = 1024 * 1024;

// Null, too, for what the images do not determine.
Json NumberAt(const YamlNode& map, const char* key) {
  if (!map.Has(key) || map.At(key).AsString() == ".inf") return nullptr;
  return map.At(key).AsNumber();
}

Json TextAt(const YamlNode& map, const char* key) {
  return map.Has(key) ? Json(map.At(key).AsString()) : Json(nullptr);
}

Json ModelJson(const std::string& name, const YamlNode& model) {
  Json json = {{"name", name},
               {"parameters", NumberAt(model, "parameters")},
               {"held_out_rms", nullptr},
               {"held_out_sigma", nullptr},
               {"image_sigma", NumberAt(model, "image_sigma")},
               {"judgement", TextAt(model, "judgement")},
               {"failure", TextAt(model, "failure")}};
  if (model.Has("held_out")) {
    json["held_out_rms"] = NumberAt(model.At("held_out"), "rms");
    json["held_out_sigma"] = NumberAt(model.At("held_out"), "sigma");
  }
  return json;
}

}  // namespace

Json TryJson(const std::filesystem::path& root, const std::filesystem::path& folder) {
  const auto file = folder / "try.yaml";
  const auto text = ReadBeneath(root, file, kMostTry);
  const YamlNode yaml = YamlNode::Parse(std::string(text.begin(), text.end()), file.string());
  Json cameras = Json::array(), models = Json::array();
  for (const YamlNode& camera : yaml.At("cameras").Elements()) cameras.push_back(camera.AsString());
  for (const auto& [name, model] : yaml.At("models").Entries()) {
    models.push_back(ModelJson(name, model));
  }
  return {{"cameras", cameras},
          {"frames", NumberAt(yaml, "frames")},
          {"folds", NumberAt(yaml, "folds")},
          {"recommended", TextAt(yaml, "recommended")},
          {"why", TextAt(yaml, "why")},
          {"target", yaml.Has("target") ? TextAt(yaml.At("target"), "why") : Json(nullptr)},
          {"models", models}};
}

}  // namespace plenocal::workbench
