// SPDX-License-Identifier: Apache-2.0
#include "targets/target.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "targets/reading.h"

namespace plenocal {
namespace {

// Keys of all types, our own and Kalibr's.
constexpr TargetKey kTolerance{
    "tolerance", "m", "standard deviation of each nominal coordinate of a marker", "fixed markers"};
constexpr TargetKey kScaleSigma{
    "scale_sigma",
    "1",
    "relative standard deviation of the size from the nominal one, a number or [x, y]",
    "exact size"};
constexpr TargetKey kMarkers{"markers",
                             "m",
                             "refined positions, number: [x, y, z]; of type markers all positions",
                             "nominal positions; type markers must have it"};
constexpr TargetKey kSigma{
    "sigma", "m", "standard deviations of the refined positions, number: [x, y, z]", "none"};
constexpr std::array kCommonKeys{TargetKey{"plenocal", "", "version of the format, 1", ""},
                                 TargetKey{"type", "", "name of the target type", ""},
                                 kTolerance,
                                 kScaleSigma,
                                 kMarkers,
                                 kSigma};

template <typename... Layouts>
std::vector<TargetType> TypesOf(std::type_identity<std::variant<Layouts...>> /*layouts*/) {
  std::vector<TargetType> types;
  (types.insert(types.end(), Layouts::kTypes.begin(), Layouts::kTypes.end()), ...);
  return types;
}

// Layout and nominal positions of the type that the key `type_key` names, which is one of `types`;
// `what` is what messages call these.
Target ReadTyped(const YamlNode& node,
                 std::string_view type_key,
                 std::span<const TargetType> types,
                 std::string_view what) {
  const std::array type_keys{type_key};
  node.RequireKeys(type_keys, fmt::format("{}: {}", type_key, types.front().name));
  const YamlNode type_node = node.At(type_key);
  const std::string name = type_node.AsString();
  for (const TargetType& type : types) {
    if (type.name != name) continue;
    std::vector<std::string_view> keys{type_key};
    if (type_key == "type") keys.insert(keys.begin(), "plenocal");
    const std::vector<std::string_view> own = internal::KeyNames(type.keys);
    keys.insert(keys.end(), own.begin(), own.end());
    keys.insert(keys.end(), {kTolerance.name, kScaleSigma.name, kMarkers.name, kSigma.name});
    node.CheckKeys(keys);
    std::vector<std::string_view> required;
    for (const TargetKey& key : type.keys) {
      const bool of_list = key.name.find('.') != std::string_view::npos;
      if (key.otherwise.empty() && !of_list) required.push_back(key.name);
    }
    node.RequireKeys(required, type.example);
    return type.read(node);
  }
  type_node.Fail(
      fmt::format("expected {}, got '{}'{}", what, name, SuggestName(name, NamesOf(types))));
}

// Layout and nominal positions of our own file; of type `markers` the layout alone.
Target ReadNominal(const YamlNode& node) {
  return ReadTyped(node, "type", TargetTypes(), "a target type");
}

bool HasNominalMarkers(const Target& target) {
  return std::visit([](const auto& layout) { return layout.kHasNominalMarkers; }, target.layout);
}

// The entries of `markers` or `sigma`.
std::map<int, std::pair<Eigen::Vector3d, YamlNode>> ReadNumbered(const YamlNode& node) {
  std::map<int, std::pair<Eigen::Vector3d, YamlNode>> numbered;
  for (const auto& [key, value] : node.Entries()) {
    int number = -1;
    const auto [end, error] = std::from_chars(key.data(), key.data() + key.size(), number);
    if (error != std::errc() || end != key.data() + key.size() || number < 0) {
      value.Fail("expected a marker's number as key; write 'number: [x, y, z]'");
    }
    const auto [first, is_new] =
        numbered.emplace(number, std::pair(internal::ReadVector(value), value));
    if (!is_new) {
      value.Fail(fmt::format("marker {} stands in line {} already; remove one of the two",
                             number,
                             first->second.second.Line()));
    }
  }
  return numbered;
}

void ReadRefinement(const YamlNode& node, Target* target) {
  const bool numbers_are_free = !HasNominalMarkers(*target);
  if (node.Has("markers") || numbers_are_free) {
    const YamlNode markers = node.At("markers");
    for (const auto& [number, entry] : ReadNumbered(markers)) {
      if (!numbers_are_free && !target->markers.contains(number)) {
        entry.second.Fail("this target has no such marker; remove it or correct the number");
      }
      target->markers[number] = entry.first;
    }
    if (target->markers.empty()) markers.Fail("expected markers; write 'number: [x, y, z]' lines");
  }
  if (!node.Has("sigma")) return;
  const YamlNode sigma = node.At("sigma");
  for (const auto& [number, entry] : ReadNumbered(sigma)) {
    if (!node.Has("markers") || !node.At("markers").Has(fmt::format("{}", number))) {
      entry.second.Fail("a sigma needs its marker; add the number to 'markers' or remove it here");
    }
    if (entry.first.minCoeff() < 0) {
      entry.second.Fail("expected standard deviations in metres, got a negative number");
    }
  }
}

// The key of a file with a length that is unknown; empty: there is none.
std::string UnknownKey(const YamlNode& node) {
  for (const auto& [key, value] : node.Entries()) {
    if (value.IsScalar() && value.AsString() == internal::kUnknown) return key;
  }
  return {};
}

// Beside an unknown length, which is 1, no other has a unit.
void CheckUnits(const YamlNode& node) {
  const std::string unknown = UnknownKey(node);
  if (unknown.empty()) return;
  for (const auto& [key, value] : node.Entries()) {
    const auto length = value.IsScalar() ? ParseLength(value.AsString()) : std::nullopt;
    if (!length || !length->has_unit) continue;
    value.Fail(
        fmt::format("'{0}' is unknown; state this as a part of it, without a unit", unknown));
  }
}

std::vector<TargetScale> ReadScaleSigma(const YamlNode& node) {
  const auto read = [](const YamlNode& number) {
    const double sigma = number.AsNumber();
    if (!(sigma > 0 && sigma < 1)) {
      number.Fail("expected a part of the size above 0 and below 1; 0.005 is 0.5 %");
    }
    return sigma;
  };
  if (!node.IsSequence()) return {{.sigma = read(node)}};
  const std::vector<YamlNode> both = node.Elements();
  if (both.size() != 2) node.Fail("expected a number, or two, of the axes: [x, y]");
  return {{.axes = Eigen::Vector3d::UnitX(), .sigma = read(both[0])},
          {.axes = Eigen::Vector3d::UnitY(), .sigma = read(both[1])}};
}

Target ReadKeys(const YamlNode& node) {
  Target target;
  if (!node.Has("plenocal") && node.Has("target_type")) {
    target = ReadTyped(node, "target_type", KalibrTargetTypes(), "a target type of Kalibr");
  } else {
    target = ReadNominal(node);
    // The version is the first key of every file, wherever the user wrote it.
    target.nominal_yaml = "plenocal: 1\n" + node.Dump({"plenocal", "markers", "sigma"});
  }
  CheckUnits(node);
  if (node.Has("tolerance")) {
    target.tolerance = node.At("tolerance").AsLength();
    if (node.Has("target_type")) {
      target.nominal_yaml += fmt::format("tolerance: {}\n", *target.tolerance);
    }
  }
  if (node.Has("scale_sigma")) {
    target.scales = ReadScaleSigma(node.At("scale_sigma"));
    if (node.Has("target_type")) {
      target.nominal_yaml += "scale_sigma: " + node.At("scale_sigma").Dump() + "\n";
    }
  }
  ReadRefinement(node, &target);
  return target;
}

}  // namespace

std::vector<TargetType> TargetTypes() { return TypesOf(std::type_identity<TargetLayout>()); }

std::span<const TargetKey> CommonTargetKeys() { return kCommonKeys; }

int PartOf(const Target& target, int marker) {
  return std::visit([&](const auto& layout) { return layout.Part(marker); }, target.layout);
}

Target ReadTarget(const std::filesystem::path& path) {
  return ReadTarget(YamlNode::ReadFile(path));
}

Target ReadTarget(const YamlNode& node) {
  if (!node.Has("target_type")) node.CheckVersion();
  return ReadKeys(node);
}

Target ReadTarget(const TargetSource& source) {
  if (!source.keys && source.file.empty()) {
    throw InputError("the session has a scene in place of a target, which this command needs");
  }
  if (!source.keys) return ReadTarget(source.file);
  if (!source.keys->IsScalar()) return ReadKeys(*source.keys);
  try {
    return TargetOfWord(source.keys->AsString());
  } catch (const Error& error) {
    source.keys->Fail(error.what());
  }
}

Target NominalTarget(const Target& target) {
  Target nominal = target;
  if (!target.unequal.empty()) {
    nominal.markers = target.unequal;
  } else if (HasNominalMarkers(target)) {
    nominal.markers = ReadNominal(YamlNode::Parse(target.nominal_yaml, "target")).markers;
  }
  return nominal;
}

std::vector<TargetPart> DrawTarget(const Target& target, Pieces pieces) {
  if (!target.unequal.empty()) {
    throw InputError("a checkerboard of unequal row and column spacing cannot be drawn");
  }
  return std::visit([&](const auto& layout) { return layout.Draw(target.markers, pieces); },
                    target.layout);
}

TargetDoubts DoubtsAbout(const Target& target) {
  const YamlNode nominal = YamlNode::Parse(target.nominal_yaml, "target");
  return std::visit(
      [&](const auto& layout) {
        TargetDoubts doubts = layout.Doubts(nominal);
        doubts.quads = layout.Quads();
        doubts.unit_is_stated = std::ranges::any_of(nominal.Entries(), [](const auto& entry) {
          if (!entry.second.IsScalar()) return false;
          const std::optional<Length> length = ParseLength(entry.second.AsString());
          return length && length->has_unit;
        });
        doubts.unknown = UnknownKey(nominal);
        for (const auto& [number, position] : target.markers) {
          const Eigen::Vector3d normal = layout.Normal(target.markers, number);
          if (!normal.isZero()) doubts.normals[number] = normal;
        }
        return doubts;
      },
      target.layout);
}

std::string RefinedTargetYaml(const Target& target,
                              const MarkerPositions& positions,
                              const MarkerPositions& sigmas) {
  const auto line = [](int number, const Eigen::Vector3d& v) {
    return fmt::format("  {}: [{:.12g}, {:.12g}, {:.12g}]\n", number, v.x(), v.y(), v.z());
  };
  const MarkerPositions nominal =
      ReadNominal(YamlNode::Parse(target.nominal_yaml, "target")).markers;
  std::string markers_yaml, sigma_yaml;
  for (const auto& [number, place] : target.markers) {
    const auto refined = positions.find(number);
    if (refined != positions.end()) {
      markers_yaml += line(number, refined->second);
      const auto sigma = sigmas.find(number);
      if (sigma != sigmas.end()) sigma_yaml += line(number, sigma->second);
      continue;
    }
    // Not refined now, but by an earlier calibration: only `markers` can hold it.
    const auto at = nominal.find(number);
    if (at == nominal.end() || at->second != place) markers_yaml += line(number, place);
  }
  std::string yaml = target.nominal_yaml;
  if (!markers_yaml.empty()) yaml += "markers:\n" + markers_yaml;
  if (!sigma_yaml.empty()) yaml += "sigma:\n" + sigma_yaml;
  return yaml;
}

}  // namespace plenocal
