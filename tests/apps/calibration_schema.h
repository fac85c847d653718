// SPDX-License-Identifier: Apache-2.0
//
// Holds JSON against engine/json/calibration.schema.json. Stricter than the schema: a key that it
// does not have is a violation.
#pragma once

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace plenocal::testing {

class CalibrationSchema {
 public:
  using Json = nlohmann::ordered_json;

  /// `docs`: folder of the documents.
  explicit CalibrationSchema(const std::filesystem::path& docs)
      : all_(Json::parse(
            std::ifstream(docs.parent_path() / "engine/json/calibration.schema.json"))) {}

  /// One of `$defs`.
  [[nodiscard]] const Json& Definition(const std::string& name) const {
    return all_.at("$defs").at(name);
  }
  [[nodiscard]] const Json& Definitions() const { return all_.at("$defs"); }

  /// Where and how `value`, as it is written, differs from a definition.
  [[nodiscard]] std::vector<std::string> Violations(const nlohmann::json& value,
                                                    const std::string& name) const {
    std::vector<std::string> found;
    Check(nlohmann::json::parse(value.dump()), Definition(name), name, &found);
    return found;
  }

 private:
  using Found = std::vector<std::string>;

  /// Keys of an object with those of its bases; its own come first.
  void Collect(const Json& schema, Json* properties, Json* required) const {
    if (schema.contains("$ref")) return Collect(Referred(schema), properties, required);
    const Json own = schema.value("properties", Json::object());
    for (const auto& [key, property] : own.items()) {
      if (!properties->contains(key)) (*properties)[key] = property;
    }
    for (const Json& key : schema.value("required", Json::array())) required->push_back(key);
    for (const Json& base : schema.value("allOf", Json::array()))
      Collect(base, properties, required);
  }

  [[nodiscard]] const Json& Referred(const Json& schema) const {
    const std::string ref = schema.at("$ref");
    return Definition(ref.substr(ref.rfind('/') + 1));
  }

  static bool HasType(const nlohmann::json& value, const std::string& type) {
    if (type == "integer") return value.is_number_integer();
    if (type == "number") return value.is_number();
    return type == value.type_name();
  }

  void Check(const nlohmann::json& value,
             const Json& schema,
             const std::string& where,
             Found* found) const {
    if (schema.contains("$ref")) return Check(value, Referred(schema), where, found);
    if (schema.contains("anyOf")) {
      Found first;  // null is the last choice
      for (const Json& each : schema.at("anyOf")) {
        Found of_this;
        Check(value, each, where, &of_this);
        if (of_this.empty()) return;
        if (first.empty()) first = of_this;
      }
      found->insert(found->end(), first.begin(), first.end());
      return;
    }
    if (schema.contains("const") && schema.at("const") != Json::parse(value.dump())) {
      found->push_back(where + ": " + value.dump());
    }
    if (schema.contains("enum")) {
      const Json& names = schema.at("enum");
      if (std::ranges::find(names, Json::parse(value.dump())) == names.end()) {
        found->push_back(where + ": " + value.dump());
      }
    }
    if (schema.contains("type")) {
      const Json& type = schema.at("type");
      const Json types = type.is_array() ? type : Json::array({type});
      if (std::ranges::none_of(types, [&](const Json& each) { return HasType(value, each); })) {
        found->push_back(where + ": expected " + types.dump() + ", got " +
                         value.dump().substr(0, 80));
        return;
      }
    }
    if (value.is_array()) CheckList(value, schema, where, found);
    if (value.is_object()) CheckKeys(value, schema, where, found);
  }

  void CheckList(const nlohmann::json& value,
                 const Json& schema,
                 const std::string& where,
                 Found* found) const {
    const auto size = value.size();
    if (size < schema.value("minItems", size) || size > schema.value("maxItems", size)) {
      found->push_back(where + ": has " + std::to_string(size) + " items");
      return;
    }
    for (size_t i = 0; i < size; ++i) {
      const Json& item =
          schema.contains("items") ? schema.at("items") : schema.at("prefixItems").at(i);
      Check(value[i], item, where + "[]", found);
    }
  }

  void CheckKeys(const nlohmann::json& value,
                 const Json& schema,
                 const std::string& where,
                 Found* found) const {
    Json properties = Json::object(), required = Json::array();
    Collect(schema, &properties, &required);
    for (const Json& key : required) {
      if (!value.contains(key.get<std::string>()))
        found->push_back(where + ": lacks " + key.dump());
    }
    for (const auto& [key, each] : value.items()) {
      if (properties.contains(key)) {
        Check(each, properties.at(key), where + "." + key, found);
      } else if (schema.contains("additionalProperties")) {
        Check(each, schema.at("additionalProperties"), where + "." + key, found);
      } else {
        found->push_back(where + ": unknown key " + key);
      }
    }
  }

  Json all_;
};

}  // namespace plenocal::testing
