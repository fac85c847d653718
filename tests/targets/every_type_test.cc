// SPDX-License-Identifier: Apache-2.0
//
// What holds for every target type, on the types' own examples: a new type is tested as soon as its
// header is in targets/types/.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "targets/target.h"
#include "tests/targets/target_texts.h"

namespace plenocal {
namespace TEST_FILE {

using testing::ErrorOf;
using testing::ExpectAt;
using ::testing::HasSubstr;
using testing::kRounding;
using ::testing::Not;
using testing::Read;
using ::testing::UnorderedElementsAre;

struct TypeExample {
  TargetType type;
  std::string name;  // of the test
  std::string text;  // of the whole file
};

std::vector<TypeExample> Examples() {
  std::vector<TypeExample> examples;
  for (const TargetType& type : TargetTypes()) {
    const std::string name(type.name);
    const std::string text = "plenocal: 1\ntype: " + name + "\n" + std::string(type.example);
    examples.push_back({type, name, text});
    if (name == "charuco") examples.push_back({type, "charuco_old", text + "legacy: true\n"});
    if (name == "aprilgrid") {
      examples.push_back({type, "aprilgrid_narrow", text + "first_id: 3\nborder_bits: 1\n"});
    }
  }
  for (const TargetType& type : KalibrTargetTypes()) {
    const std::string name(type.name);
    examples.push_back(
        {type, "kalibr_" + name, "target_type: " + name + "\n" + std::string(type.example)});
  }
  return examples;
}

// The text without a key of its root and what belongs to it.
std::string Without(const std::string& text, const std::string& key) {
  const size_t begin = text.find("\n" + key + ":") + 1;
  size_t end = text.find('\n', begin) + 1;
  while (end < text.size() && (text[end] == ' ' || text[end] == '-'))
    end = text.find('\n', end) + 1;
  return text.substr(0, begin) + text.substr(end);
}

class EveryTargetType : public ::testing::TestWithParam<TypeExample> {};

TEST_P(EveryTargetType, ReadsItsExample) {
  const Target target = Read(GetParam().text);
  EXPECT_GE(target.markers.size(), 2u);
  EXPECT_FALSE(target.tolerance.has_value());
  // Its nominal keys read back give the same pattern.
  const Target nominal = NominalTarget(target);
  EXPECT_EQ(nominal.layout.index(), target.layout.index());
  EXPECT_EQ(nominal.markers.size(), target.markers.size());
}

TEST_P(EveryTargetType, DoubtsOnlyWhatItHas) {
  const Target target = Read(GetParam().text);
  const TargetDoubts doubts = DoubtsAbout(target);
  for (const TargetHypothesis& hypothesis : doubts.hypotheses) {
    EXPECT_EQ(hypothesis.code.substr(0, 7), "target_");
    EXPECT_FALSE(hypothesis.what.empty() || hypothesis.remedy.empty());
    bool differs = false;
    for (const auto& [number, places] : hypothesis.places()) {
      ASSERT_TRUE(target.markers.contains(number)) << hypothesis.what;
      ASSERT_FALSE(places.empty());
      differs = differs || places.size() > 1 ||
                (places.front() - target.markers.at(number)).norm() > kRounding;
    }
    EXPECT_TRUE(differs) << hypothesis.what;
  }
  for (const TargetNumber& number : doubts.numbers) {
    EXPECT_GT(number.stated, number.least);
    EXPECT_LT(number.stated, number.most);
    // The file with another value has the markers that the derivatives predict.
    const Target nominal = NominalTarget(target);
    std::string text = nominal.nominal_yaml;
    const size_t begin = text.find("\n" + number.key + ":") + 1, end = text.find('\n', begin);
    text.replace(begin, end - begin, number.key + ": 1.5");
    for (const auto& [marker, p] : Read(text).markers) {
      const Eigen::Vector3d expected =
          nominal.markers.at(marker) + (1.5 - number.stated) * number.by_number.at(marker);
      EXPECT_LT((p - expected).norm(), kRounding) << marker;
    }
  }
}

TEST_P(EveryTargetType, RefusesUnknownKeys) {
  EXPECT_THAT(ErrorOf(GetParam().text + "tolerence: 1\n"), HasSubstr("did you mean 'tolerance'?"));
}

TEST_P(EveryTargetType, MissesEachKeyWithoutDefaultAndNoOther) {
  int checked = 0;
  for (const TargetKey& key : GetParam().type.keys) {
    if (key.name.find('.') != std::string_view::npos) continue;  // of a list's elements
    const std::string name(key.name);
    if (GetParam().text.find("\n" + name + ":") == std::string::npos) {
      EXPECT_FALSE(key.otherwise.empty()) << name << " must be in the example";
      continue;
    }
    const std::string message = ErrorOf(Without(GetParam().text, name));
    if (key.otherwise.empty()) {
      EXPECT_THAT(message, HasSubstr(name + ": this key is missing"));
    } else {
      EXPECT_EQ(message, "no refusal") << name;
    }
    ++checked;
  }
  EXPECT_GE(checked, GetParam().type.keys.empty() ? 0 : 2);
}

TEST_P(EveryTargetType, DescribesItsKeys) {
  for (const TargetKey& key : GetParam().type.keys) {
    EXPECT_FALSE(key.name.empty());
    EXPECT_FALSE(key.meaning.empty()) << key.name;
  }
}

TEST_P(EveryTargetType, ReadsItsRefinementBack) {
  const Target nominal = Read(GetParam().text + "tolerance: 0.0003\n");
  std::map<int, Eigen::Vector3d> positions, sigmas;
  for (const auto& [number, place] : nominal.markers) {
    positions[number] = place + Eigen::Vector3d(1.0 / 3000, -2.0 / 7000, 1e-7 * number);
    sigmas[number] = Eigen::Vector3d(1e-5, 2e-5, 3e-5);
  }
  const auto last = std::prev(nominal.markers.end());
  positions.erase(last->first);
  sigmas.erase(last->first);

  const std::string yaml = RefinedTargetYaml(nominal, positions, sigmas);
  EXPECT_THAT(yaml, ::testing::StartsWith("plenocal: 1\ntype: "));
  EXPECT_THAT(yaml, HasSubstr("\nmarkers:\n  "));
  EXPECT_THAT(yaml, HasSubstr(": [1e-05, 2e-05, 3e-05]\n"));
  const Target refined = Read(yaml);
  EXPECT_EQ(refined.layout.index(), nominal.layout.index());
  EXPECT_EQ(refined.nominal_yaml, nominal.nominal_yaml);
  EXPECT_EQ(refined.tolerance, nominal.tolerance);
  ASSERT_EQ(refined.markers.size(), nominal.markers.size());
  for (const auto& [number, p] : positions) ExpectAt(refined, number, p.x(), p.y(), p.z());
  // The marker that was not refined keeps its place, now and after the next calibration.
  const Eigen::Vector3d p = last->second;
  ExpectAt(refined, last->first, p.x(), p.y(), p.z());
  const Target again = Read(RefinedTargetYaml(refined, {}, {}));
  for (const auto& [number, q] : refined.markers) ExpectAt(again, number, q.x(), q.y(), q.z());
}

TEST_P(EveryTargetType, HasUnitNormalsOnThePrintedSide) {
  const Target target = Read(GetParam().text);
  std::visit(
      [&](const auto& layout) {
        for (const auto& [number, position] : target.markers) {
          const double length = layout.Normal(target.markers, number).norm();
          EXPECT_NEAR(length, layout.kHasNominalMarkers ? 1 : 0, 1e-12) << number;
        }
      },
      target.layout);
}

INSTANTIATE_TEST_SUITE_P(Targets,
                         EveryTargetType,
                         ::testing::ValuesIn(Examples()),
                         [](const auto& example) { return example.param.name; });

TEST(TargetTypes, AreThoseOfTheFolder) {
  std::vector<std::string> names;
  for (const TargetType& type : TargetTypes()) names.emplace_back(type.name);
  EXPECT_THAT(names,
              ::testing::IsSupersetOf(
                  {"apriltag", "aprilgrid", "chessboard", "charuco", "circles", "markers"}));
  std::sort(names.begin(), names.end());
  EXPECT_EQ(std::adjacent_find(names.begin(), names.end()), names.end()) << "a name twice";
  size_t headers = 0;
  for (const auto& entry : std::filesystem::directory_iterator(PLENOCAL_TARGET_TYPES)) {
    headers += entry.path().extension() == ".h" ? 1 : 0;
  }
  EXPECT_EQ(std::variant_size_v<TargetLayout>, headers);
}

TEST(TargetTypes, ShareTheKeysOfRefinements) {
  std::vector<std::string> names;
  for (const TargetKey& key : CommonTargetKeys()) names.emplace_back(key.name);
  EXPECT_THAT(
      names,
      UnorderedElementsAre("plenocal", "type", "tolerance", "scale_sigma", "markers", "sigma"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
