// SPDX-License-Identifier: Apache-2.0
#include "engine/session/look_alikes.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include "models/registry.h"
#include "tests/refusal.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::StartsWith;

const std::string kGrid = "aprilgrid:3x2:40mm:0.3:tag36h11";

SessionCamera Camera(const std::string& name, const char* model = "pinhole", bool images = true) {
  SessionCamera camera;
  camera.name = name;
  camera.model = FindModel(CameraModels(), model);
  if (images) camera.images = {"*.png"};
  return camera;
}

/// A session with targets of these words, named a, b, c.
struct Several {
  explicit Several(const std::vector<std::string>& words) {
    session.path = "s.yaml";
    session.cameras = {Camera("left")};
    for (const std::string& word : words) {
      targets.push_back(TargetOfWord(word));
      SessionTarget& target = session.targets.emplace_back();
      target.name = std::string(1, static_cast<char>('a' + targets.size() - 1));
      target.source = TargetNamed(word);
    }
  }
  std::vector<IdenticalBoards> Check() const { return CheckDistinct(session, targets); }
  /// "" where nothing is refused, else the words after the start of the message.
  [[nodiscard]] std::string Refusal() const {
    const std::string text = RefusalOf([&] { Check(); });
    if (text == "no refusal") return "";
    const std::string start = "s.yaml: targets ",
                      end =
                          "; print one with other ids (aprilgrid: "
                          "'first_id'), of another family, or with another number of squares";
    EXPECT_THAT(text, StartsWith(start));
    EXPECT_TRUE(text.ends_with(end)) << text;
    return text.substr(start.size(), text.size() - start.size() - end.size());
  }

  Session session = {};
  std::vector<Target> targets = {};
};

TEST(LookAlikes, OfBoardsAreRefused) {
  const std::string same = "a and b look alike in images: the same pattern with the same counts";
  struct Case {
    const char *a, *b;
    bool alike;
  };
  for (const Case& each :
       {Case{"chessboard:9x6:25mm", "chessboard:9x6:40mm", true},
        {"chessboard:9x6:25mm", "chessboard:6x9:25mm", true},
        {"chessboard:9x6:25mm", "chessboard:9x7:25mm", false},
        {"chessboard:9x6:25mm", "chessboard:8x6:25mm", false},
        {"chessboard:9x6:25mm", "circles:9x6:25mm", false},
        {"circles:9x6:25mm", "circles:6x9:20mm", true},
        {"circles:9x6:25mm", "circles:9x7:25mm", false},
        {"circles:4x11:25mm:asymmetric", "circles:4x11:25mm", false},
        {"circles:4x11:25mm:asymmetric", "circles:4x11:5mm:asymmetric", true},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:5x7:10mm:5mm:6X6_250", true},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:7x5:100mm:50mm:6X6_250", false},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:5x9:100mm:50mm:6X6_250", false},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:5x7:100mm:50mm:5X5_250", false},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:5x7:100mm:50.9mm:6X6_250", true},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:5x7:100mm:51.1mm:6X6_250", false},
        {"charuco:5x7:100mm:50mm:6X6_250", "charuco:5x7:100mm:48.9mm:6X6_250", false},
        {"charuco:5x6:100mm:50mm:6X6_250", "charuco:5x6:100mm:50mm:6X6_250:legacy=true", false}}) {
    EXPECT_EQ(Several({each.a, each.b}).Refusal(), each.alike ? same : "") << each.a << each.b;
    EXPECT_EQ(Several({each.b, each.a}).Refusal(), each.alike ? same : "") << each.a << each.b;
  }
}

TEST(LookAlikes, OfTagsAreToldApartByTheirPose) {
  struct Case {
    std::string other;
    bool alike;
  };
  for (const Case& each : {Case{kGrid, true},
                           {"aprilgrid:3x2:80mm:0.3:tag36h11", true},  // another size is not seen
                           {"aprilgrid:3x2:40mm:0.5:tag36h11", false},
                           {"aprilgrid:3x3:40mm:0.3:tag36h11", false},
                           {"aprilgrid:3x2:40mm:0.3:tag25h9", false},
                           {kGrid + ":border_bits=1", false},
                           {kGrid + ":first_id=6", false},
                           {"chessboard:3x2:40mm", false}}) {
    const std::vector<IdenticalBoards> pairs =
        Several({"chessboard:9x6:9mm", kGrid, each.other}).Check();
    ASSERT_EQ(pairs.size(), each.alike ? 1U : 0U) << each.other;
    if (!each.alike) continue;
    EXPECT_EQ(pairs[0].first, 1U);
    EXPECT_EQ(pairs[0].second, 2U);
    EXPECT_EQ(pairs[0].first_name, "b");
    EXPECT_EQ(pairs[0].second_name, "c");
    EXPECT_FALSE(pairs[0].T_first_second);
  }
}

TEST(LookAlikes, HaveTheirKnownPose) {
  const RigidTransform one{ExpRotation({0.1, 0.2, 0.3}), {1, 2, 3}};
  const RigidTransform other{ExpRotation({-0.4, 0.1, 0.6}), {-2, 0.5, 7}};
  const Eigen::Vector3d p(0.3, -0.7, 0.2);
  Several two({kGrid, kGrid});
  EXPECT_FALSE(two.Check()[0].T_first_second);
  two.session.targets[1].known = other;
  // The frame of known poses is that of the first.
  EXPECT_LT((*two.Check()[0].T_first_second * p - other * p).norm(), 1e-12);
  Several three({"chessboard:9x6:9mm", kGrid, kGrid});
  three.session.targets[2].known = other;
  EXPECT_FALSE(three.Check()[0].T_first_second);
  three.session.targets[1].known = one;
  EXPECT_LT((one * (*three.Check()[0].T_first_second * p) - other * p).norm(), 1e-12);
  three.session.targets[2].known.reset();
  EXPECT_FALSE(three.Check()[0].T_first_second);
}

TEST(LookAlikes, OfTagsAreRefusedWhereTheirPoseShowsNothing) {
  for (const size_t k : {0U, 1U}) {
    Several moving({kGrid, kGrid});
    moving.session.targets[k].moves = true;
    EXPECT_EQ(
        moving.Refusal(),
        "a and b look alike in images: the same tags in the same arrangement, and one of them "
        "is 'free'");
  }
  Several points({kGrid, kGrid});
  points.session.cameras.push_back(Camera("right", "pinhole", false));
  EXPECT_EQ(points.Refusal(),
            "a and b look alike in images: the same tags in the same arrangement, and a camera has "
            "'detections' in place of images");
  EXPECT_EQ(Several({kGrid, kGrid, kGrid}).Refusal(),
            "a and c look alike in images: more than two targets of the same tags in the same "
            "arrangement");
}

TEST(LookAlikes, AreNoneWithoutImages) {
  Several points({"chessboard:9x6:25mm", "chessboard:9x6:25mm"});
  points.session.cameras = {Camera("left", "pinhole", false)};
  EXPECT_TRUE(points.Check().empty());
}

TEST(LookAlikes, OfSharedNumbersAreRefusedBeforeAPlenopticCamera) {
  const auto refusal = [](const std::string& a, const std::string& b, bool images = true) {
    Several two({a, b});
    two.session.cameras.push_back(Camera("raw", "focused-plenoptic", images));
    return two.Refusal();
  };
  const std::string shared =
      "a and b look alike in images: tags of the same numbers, which are told apart in images of "
      "ordinary cameras only (raw is plenoptic)";
  // The last tag of the first has the number 5.
  EXPECT_EQ(refusal(kGrid, "aprilgrid:2x2:40mm:0.3:tag36h11:first_id=5"), shared);
  EXPECT_EQ(refusal(kGrid, "aprilgrid:2x2:40mm:0.3:tag36h11:first_id=6"), "");
  EXPECT_EQ(refusal(kGrid, "aprilgrid:2x2:40mm:0.3:tag25h9"), "");
  EXPECT_EQ(refusal("charuco:5x7:100mm:50mm:6X6_250", "charuco:3x3:100mm:50mm:6X6_250"), shared);
  EXPECT_EQ(refusal("chessboard:9x6:25mm", "chessboard:5x4:25mm"), "");
  EXPECT_EQ(refusal(kGrid, "aprilgrid:2x2:40mm:0.3:tag36h11", false), "");
}

// ---- other targets of a detector

/// "before/all" of the other targets of each target.
std::string OthersOf(const std::vector<std::string>& words) {
  std::vector<Target> targets;
  for (const std::string& word : words) targets.push_back(TargetOfWord(word));
  std::string text;
  for (size_t k = 0; k < targets.size(); ++k) {
    const OtherTargets others = OtherTargetsOf(targets, k);
    text += fmt::format("{}/{} ", others.before_own, others.targets.size());
  }
  return text;
}

TEST(OtherTargets, AreThoseOfTheFamilyWhereNumbersAreShared) {
  const std::string small = "aprilgrid:2x2:40mm:0.3:tag36h11";
  EXPECT_EQ(OthersOf({kGrid, small}), "0/1 1/1 ");
  EXPECT_EQ(OthersOf({"chessboard:9x6:25mm", kGrid, "aprilgrid:2x2:40mm:0.3:tag25h9", small}),
            "0/0 0/1 0/0 1/1 ");
  EXPECT_EQ(OthersOf({kGrid, small + ":first_id=6"}), "0/0 0/0 ");
  EXPECT_EQ(OthersOf({kGrid, small + ":first_id=5"}), "0/1 1/1 ");
  // If two of the family share numbers, the third is among the others too.
  EXPECT_EQ(OthersOf({kGrid, small, small + ":first_id=100"}), "0/2 1/2 2/2 ");
  EXPECT_EQ(OthersOf({"chessboard:9x6:25mm", "chessboard:5x4:25mm"}), "0/1 1/1 ");
  EXPECT_EQ(OthersOf({"circles:9x6:25mm", "circles:5x4:25mm", "circles:4x11:9mm:asymmetric"}),
            "0/1 1/1 0/0 ");
  EXPECT_EQ(OthersOf({"charuco:5x7:100mm:50mm:6X6_250",
                      "charuco:3x3:100mm:50mm:6X6_250",
                      "charuco:3x3:100mm:50mm:5X5_250"}),
            "0/1 1/1 0/0 ");
  EXPECT_EQ(OthersOf({kGrid}), "0/0 ");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
