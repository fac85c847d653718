// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/session_fields.h"

#include <algorithm>
#include <optional>
#include <utility>
#include <vector>

#include "apps/workbench/project/session_text.h"
#include "calib/files/session.h"
#include "models/registry.h"
#include "targets/target.h"

namespace plenocal::workbench {
namespace {

using Json = nlohmann::json;

struct Field {
  std::vector<std::string> path;
  std::string what;
  std::string_view unit = {};
  bool required = false;
  Json choices = Json::array();
};

// Adds a field of a key of `map`, unless its value is more than a field can hold.
void AddField(const YamlNode& map, const Field& field, Json* fields) {
  std::string value;
  if (const auto node = map.Find(field.path.back())) {
    if (node->IsMap() || node->IsSequence()) return;
    if (node->IsScalar()) value = node->AsString();
  }
  fields->push_back({{"path", field.path},
                     {"value", value},
                     {"what", field.what},
                     {"unit", field.unit},
                     {"required", field.required},
                     {"choices", field.choices}});
}

std::string ScalarOf(const YamlNode& map, std::string_view key) {
  const auto node = map.Find(key);
  return node && node->IsScalar() ? node->AsString() : std::string();
}

std::optional<TargetType> TypeNamed(const std::string& name) {
  const std::vector<TargetType> types = TargetTypes();
  const auto found = std::ranges::find(types, name, &TargetType::name);
  return found == types.end() ? std::nullopt : std::optional(*found);
}

}  // namespace

Json SessionFields(const YamlNode& session) {
  Json fields = Json::array(), models = Json::array({kAuto});
  for (const CameraModel& model : CameraModels()) models.push_back(model.name);
  const auto cameras = session.Find("cameras");
  if (!cameras || !cameras->IsMap()) return fields;
  for (const auto& [name, camera] : cameras->Entries()) {
    const std::vector<std::string> path{"cameras", name};
    const auto of_camera = [&](std::string_view key) {
      std::vector<std::string> whole = path;
      whole.emplace_back(key);
      return whole;
    };
    AddField(camera,
             {of_camera("model"),
              "camera model; auto: the best one by images that are held out",
              "",
              true,
              models},
             &fields);
    const auto model =
        std::ranges::find(CameraModels(), ScalarOf(camera, "model"), &CameraModel::name);
    if (model == CameraModels().end()) continue;
    for (const Param& config : model->config) {
      AddField(
          camera, {of_camera(config.name), "value in the data sheet", config.unit, true}, &fields);
    }
  }
  const auto options = session.Find("options");
  AddField(
      options ? *options : session,
      {{"options", "refine_target"},
       "true: positions of the target's points are estimated, too; auto: where the target is bent",
       "",
       false,
       Json::array({kAuto, "true", "false"})},
      &fields);
  return fields;
}

Json TargetFields(const YamlNode& target) {
  Json fields = Json::array(), types = Json::array();
  if (!target.IsMap() || target.Has("target_type")) return fields;  // Kalibr's own file
  for (const TargetType& type : TargetTypes()) types.push_back(type.name);
  AddField(target, {{"type"}, "kind of target", "", true, types}, &fields);
  const auto type = TypeNamed(ScalarOf(target, "type"));
  if (!type) return fields;
  for (const TargetKey& key : type->keys) {
    if (key.name.find('.') != std::string_view::npos) continue;
    AddField(target,
             {{std::string(key.name)}, std::string(key.meaning), key.unit, key.otherwise.empty()},
             &fields);
  }
  for (const TargetKey& key : CommonTargetKeys()) {
    if (key.name != "tolerance" && key.name != "scale_sigma") continue;
    AddField(target, {{std::string(key.name)}, std::string(key.meaning), key.unit}, &fields);
  }
  return fields;
}

std::string WithTargetType(std::string text, const std::string& name) {
  const auto type = TypeNamed(name);
  text = WithValue(text, {"type"}, name);
  if (!type) return text;
  const auto has = [&](std::string_view key) {
    return std::ranges::find(type->keys, key, &TargetKey::name) != type->keys.end();
  };
  for (const TargetType& other : TargetTypes()) {
    for (const TargetKey& key : other.keys) {
      if (!has(key.name)) text = WithoutKey(text, std::string(key.name));
    }
  }
  return text;
}

}  // namespace plenocal::workbench
