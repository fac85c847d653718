// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/session_fields.h"

#include <gmock/gmock.h>

#include <algorithm>

namespace plenocal::workbench {
namespace TEST_FILE {

using Json = nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

// "keys: value" of each field, "!" where it is required.
std::vector<std::string> Values(const Json& fields) {
  std::vector<std::string> values;
  for (const Json& field : fields) {
    std::string text;
    for (const Json& key : field["path"]) text += key.get<std::string>() + " ";
    values.push_back(text + "= " + field["value"].get<std::string>() +
                     (field["required"].get<bool>() ? " !" : ""));
    EXPECT_FALSE(field["what"].get<std::string>().empty());
  }
  return values;
}

Json Session(const char* text) { return SessionFields(YamlNode::Parse(text, "session.yaml")); }
Json Target(const char* text) { return TargetFields(YamlNode::Parse(text, "target.yaml")); }

TEST(SessionFields, AreModelsWhatTheseNeedAndTheTarget) {
  const Json fields = Session(
      "cameras:\n  left: {model: pinhole}\n  raw: {model: focused-plenoptic, pixel_size: 5.5 um}\n"
      "options: {refine_target: auto}\n");
  EXPECT_THAT(Values(fields),
              ElementsAre("cameras left model = pinhole !",
                          "cameras raw model = focused-plenoptic !",
                          "cameras raw pixel_size = 5.5 um !",
                          "options refine_target = auto"));
  const Json& models = fields[0]["choices"];
  EXPECT_EQ(models[0], "auto");
  EXPECT_NE(std::ranges::find(models, "kannala-brandt4"), models.end());
  EXPECT_EQ(fields[2]["unit"], "m");
  EXPECT_TRUE(fields[2]["choices"].empty());
  EXPECT_EQ(fields[3]["choices"], Json({"auto", "true", "false"}));
}

TEST(SessionFields, OfAModelThatIsNotKnownHaveTheModelAlone) {
  EXPECT_THAT(
      Values(Session("cameras:\n  left: {model: pinhol}\n  right: {images: a}\n")),
      ElementsAre(
          "cameras left model = pinhol !", "cameras right model =  !", "options refine_target = "));
  // What a field cannot hold has none.
  EXPECT_THAT(Values(Session("cameras:\n  left: {model: [a, b]}\n")),
              ElementsAre("options refine_target = "));
  EXPECT_TRUE(Session("cameras: [a]\n").empty());
  EXPECT_TRUE(Session("plenocal: 1\n").empty());
}

TEST(TargetFields, AreTheTypeItsKeysAndTheTolerance) {
  const Json fields =
      Target("type: chessboard\ncolumns: 9\nrows: 6\nsquare: 25 mm\ntolerance: 0.1 mm\n");
  EXPECT_THAT(Values(fields),
              ElementsAre("type = chessboard !",
                          "columns = 9 !",
                          "rows = 6 !",
                          "square = 25 mm !",
                          "tolerance = 0.1 mm",
                          "scale_sigma = "));
  EXPECT_EQ(fields[3]["unit"], "m");
  EXPECT_NE(std::ranges::find(fields[0]["choices"], "charuco"), fields[0]["choices"].end());
  EXPECT_THAT(Values(Target("type: chessbord\n")), ElementsAre("type = chessbord !"));
  EXPECT_THAT(Values(Target("{}\n")), ElementsAre("type =  !"));
  EXPECT_TRUE(Target("target_type: aprilgrid\ntagCols: 6\n").empty());  // Kalibr's own file
  EXPECT_TRUE(Target("[1, 2]\n").empty());
}

TEST(WithTargetType, LeavesOutTheKeysOfOtherTypes) {
  const std::string text =
      WithTargetType("# mine\ntype: chessboard\ncolumns: 9\nrows: 6\nsquare: 25 mm\n", "circles");
  EXPECT_THAT(text, HasSubstr("# mine\ntype: circles\ncolumns: 9\nrows: 6\n"));
  EXPECT_THAT(text, Not(HasSubstr("square")));
  const std::string unknown = WithTargetType("type: chessboard\nsquare: 1\n", "round");
  EXPECT_EQ(unknown, "type: round\nsquare: 1\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::workbench
