// SPDX-License-Identifier: Apache-2.0
//
// Right images before a wrong description of the target, or the other way round. The board has 10 x
// 7 points, number 10 * row + column, 30 mm apart; in some tests they are the corners of 15 tags.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "assess/causes/diagnose.h"
#include "assess/target/flatness.h"
#include "models/registry.h"
#include "tests/calib/synthetic.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using testing::MakeProblem;
using testing::SyntheticProblem;

constexpr double kSpacing = 0.03;

SyntheticProblem Board(unsigned seed) { return MakeProblem(seed, {.frames = 12, .noise = 0.1}); }

// Corner k of the tag at a column 0 to 4 and a row 0 to 2.
std::array<int, 4> Tag(int column, int row) {
  const int first = 20 * row + 2 * column;
  return {first + 10, first + 11, first + 1, first};
}

TargetDoubts Tags() {
  TargetDoubts doubts;
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 5; ++column) doubts.quads.push_back(Tag(column, row));
  }
  return doubts;
}

std::vector<Finding> Find(const CalibrationInput& input, const TargetDoubts& doubts) {
  const Calibration calibration = Calibrate(input, {.threads = 1, .progress = {}});
  return FindTargetCauses(input, doubts, &calibration);
}

std::vector<std::string> CodesOf(const std::vector<Finding>& findings) {
  std::vector<std::string> codes;
  for (const Finding& finding : findings) codes.push_back(finding.code);
  return codes;
}

// Rows of `columns` points.
CandidatePlaces Rows(int columns) {
  CandidatePlaces places;
  for (int i = 0; i < 70; ++i) {
    const int column = i % columns, row = i / columns;
    places[i] = {Eigen::Vector3d(kSpacing * column, kSpacing * row, 0)};
  }
  return places;
}

TargetDoubts OtherRows() {
  TargetDoubts doubts;
  for (const int columns : {5, 7, 8, 9, 10, 11, 14}) {
    doubts.hypotheses.push_back({.code = "target_layout",
                                 .what = "rows of " + std::to_string(columns),
                                 .remedy = "set columns",
                                 .places = [columns] { return Rows(columns); }});
  }
  return doubts;
}

TEST(TargetCauses, AreNoneOfARightTarget) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    const SyntheticProblem problem = Board(seed);
    TargetDoubts doubts = OtherRows();
    doubts.quads = Tags().quads;
    EXPECT_THAT(Find(problem.input, doubts), IsEmpty()) << seed;
    EXPECT_THAT(Find(problem.input, {}), IsEmpty()) << seed;
  }
}

TEST(TargetCauses, NameRowsOfAnotherLength) {
  SyntheticProblem problem = Board(1);
  for (auto& [number, p] : problem.input.markers) p = Rows(7).at(number).front();
  // Without a calibration, which may have failed.
  const std::vector<Finding> causes = FindTargetCauses(problem.input, OtherRows(), nullptr);
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_layout"));
  EXPECT_THAT(causes[0].what, HasSubstr("rows of 10"));
  EXPECT_EQ(causes[0].grade, Grade::kBad);
}

// Pairs of columns one part apart, the pairs `gap` parts apart: 1 in truth.
TargetNumber StateAWrongGap(CalibrationInput* input, double stated = 0.4) {
  TargetNumber gap{.code = "target_spacing",
                   .key = "spacing",
                   .meaning = "gap / size",
                   .stated = stated,
                   .least = 0.01,
                   .most = 4,
                   .by_number = {}};
  for (auto& [number, p] : input->markers) {
    const int tag = number % 10 / 2;
    const Eigen::Vector3d slope(kSpacing * tag, 0, 0);
    gap.by_number[number] = slope;
    p += (gap.stated - 1) * slope;
  }
  return gap;
}

TEST(TargetCauses, EstimateAWrongNumber) {
  SyntheticProblem problem = Board(2);
  const TargetNumber gap = StateAWrongGap(&problem.input);
  const std::vector<Finding> causes = Find(problem.input, {{}, {gap}, {}});
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_spacing"));
  EXPECT_NEAR(causes[0].value.value(), 1, 0.003);
  EXPECT_THAT(causes[0].remedy, HasSubstr("set spacing: "));
}

// So little that the points still fit a smooth map.
TEST(TargetCauses, EstimateANumberThatIsWrongBySomePerCent) {
  for (const double stated : {0.94, 0.98, 1.02, 1.06}) {
    SyntheticProblem problem = Board(2);
    const TargetNumber gap = StateAWrongGap(&problem.input, stated);
    const std::vector<Finding> causes = Find(problem.input, {{}, {gap}, {}});
    ASSERT_THAT(CodesOf(causes), ElementsAre("target_spacing")) << stated;
    EXPECT_NEAR(causes[0].value.value(), 1, 0.003) << stated;
  }
  SyntheticProblem right = Board(2);
  const TargetNumber gap = StateAWrongGap(&right.input, 1);
  EXPECT_THAT(Find(right.input, {{}, {gap}, {}}), IsEmpty());
}

// The same views through a fisheye, from so near that no smooth map of the plane describes them.
void LookThroughAFisheye(SyntheticProblem* problem) {
  CameraInput& camera = problem->input.cameras[0];
  camera.model = FindModel(CameraModels(), "kannala-brandt4");
  const std::vector<double> params{350, 350, 640, 480, 0, 0, 0, 0};
  camera.initial.assign(params.size(), std::nullopt);
  camera.fixed.assign(params.size(), false);
  std::mt19937 random(1);
  std::normal_distribution<double> noise(0, 0.1);
  camera.views.clear();
  for (auto [frame, T_camera_target] : problem->T_rig_target) {
    T_camera_target.t *= 0.12;
    View view{frame, {}};
    for (const auto& [number, p] : problem->markers) {
      Observation seen{.marker = number, .detector_sigma = 0.1};
      double* px = seen.values.data();
      if (!camera.model->Project(params.data(), nullptr, px, T_camera_target * p, px)) continue;
      for (int axis = 0; axis < 2; ++axis) px[axis] += noise(random);
      if (std::abs(px[0] - 640) < 640 && std::abs(px[1] - 480) < 480) {
        view.observations.push_back(seen);
      }
    }
    if (view.observations.size() >= 12) camera.views.push_back(view);
  }
}

TEST(TargetCauses, EstimateAWrongNumberThroughAFisheye) {
  for (const unsigned seed : {4, 5, 6}) {
    SyntheticProblem problem = Board(seed);
    LookThroughAFisheye(&problem);
    const TargetNumber gap = StateAWrongGap(&problem.input);
    const std::vector<Finding> causes = FindTargetCauses(problem.input, {{}, {gap}, {}}, nullptr);
    ASSERT_THAT(CodesOf(causes), ElementsAre("target_spacing")) << seed;
    EXPECT_NEAR(causes[0].value.value(), 1, 0.05) << seed;
  }
}

TEST(TargetCauses, ChooseBetweenPlaces) {
  SyntheticProblem problem = Board(3);
  // Each number belongs to the point on its left or on its right.
  CandidatePlaces places;
  for (const auto& [number, p] : problem.input.markers) {
    const Eigen::Vector3d step(kSpacing, 0, 0);
    places[number] = {p + step, p - step};
  }
  const TargetHypothesis hypothesis{
      .code = "target_legacy", .what = "other", .remedy = "set legacy", .places = [places] {
        return places;
      }};
  for (View& view : problem.input.cameras[0].views) {
    std::map<int, Observation> by_number;
    for (const Observation& o : view.observations) by_number[o.marker] = o;
    view.observations.clear();
    for (int row = 0; row < 7; ++row) {
      for (int column = 1; column < 9; ++column) {
        const int number = 10 * row + column, shift = number * 7 % 5 < 3 ? 1 : -1;
        const auto found = by_number.find(number + shift);
        if (found == by_number.end()) continue;
        view.observations.push_back(found->second);
        view.observations.back().marker = number;
      }
    }
  }
  EXPECT_THAT(CodesOf(FindTargetCauses(problem.input, {{hypothesis}, {}, {}}, nullptr)),
              ElementsAre("target_legacy"));
}

TEST(TargetCauses, SeeTwoTargets) {
  SyntheticProblem problem = Board(4);
  for (View& view : problem.input.cameras[0].views) {
    for (Observation& o : view.observations) {
      if (o.marker * 13 % 10 < 4) o.values[0] += 0.4 * o.values[1] + 200;
    }
  }
  EXPECT_THAT(CodesOf(FindTargetCauses(problem.input, OtherRows(), nullptr)),
              ElementsAre("target_ids_twice"));
}

TEST(TargetCauses, NameAWrongUnit) {
  SyntheticProblem problem = Board(5);
  for (auto& [number, p] : problem.input.markers) p *= 1000;
  const std::vector<Finding> causes = Find(problem.input, {});
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_scale"));
  EXPECT_THAT(causes[0].what, HasSubstr("in millimetres"));
  EXPECT_THAT(causes[0].remedy, HasSubstr("multiply them by 0.001"));
  TargetDoubts with_unit;
  with_unit.unit_is_stated = true;
  EXPECT_THAT(Find(problem.input, with_unit), IsEmpty());
  EXPECT_THAT(causes[0].remedy, HasSubstr("or was 'unknown' meant?"));
  TargetDoubts of_unknown_size;
  of_unknown_size.unknown = "square";
  const std::vector<Finding> notes = Find(problem.input, of_unknown_size);
  ASSERT_THAT(CodesOf(notes), ElementsAre("target_size_unknown"));
  EXPECT_EQ(notes[0].grade, Grade::kGood);
  EXPECT_THAT(notes[0].what, HasSubstr("1 m in this result is one square"));
}

TEST(BentTarget, IsMeasured) {
  SyntheticProblem problem = Board(6);
  // 3 mm from the middle to the edges.
  for (auto& [number, p] : problem.input.markers) {
    p.z() = 0.003 * std::pow((p.x() - 4.5 * kSpacing) / (4.5 * kSpacing), 2);
  }
  const auto find = [&] {
    return FindBentTarget(Calibrate(problem.input, {}), problem.input.loss, [] { return true; });
  };
  const std::optional<BentTarget> bent = find();
  ASSERT_TRUE(bent.has_value());
  EXPECT_EQ(bent->finding.code, "target_not_flat");
  EXPECT_THAT(bent->finding.what, HasSubstr("3.2 mm out of its plane"));
  // The markers lie in one plane, in the mean of the stated places.
  double mean = 0, squares = 0;
  const auto count = static_cast<double>(problem.input.markers.size());
  for (const auto& [number, p] : problem.input.markers) mean += p.z() / count;
  for (const auto& [number, p] : problem.input.markers) squares += std::pow(p.z() - mean, 2);
  const double rms = 1e3 * std::sqrt(squares / (3 * count));
  EXPECT_THAT(bent->finding.what,
              HasSubstr(fmt::format("peak, {:.2g} mm RMS per coordinate", rms)));
  EXPECT_THAT(bent->finding.what, HasSubstr("f_x of cam0 by"));
  EXPECT_THAT(bent->finding.remedy, HasSubstr(" mm in the target's file"));
  EXPECT_GT(bent->finding.value.value(), 0.1);
  EXPECT_NEAR(bent->residual[0], 0.1, 0.01);
  // With a tolerance the calibration has estimated the shape.
  problem.input.marker_freedom = MarkerFreedom::FromSigma(0.001);
  EXPECT_FALSE(find().has_value());
}

TEST(TargetCauses, NameMirroredImages) {
  SyntheticProblem problem = Board(9);
  TargetDoubts doubts;
  for (const auto& [number, p] : problem.input.markers) {
    doubts.normals[number] = Eigen::Vector3d(0, 0, -1);
  }
  EXPECT_THAT(Find(problem.input, doubts), IsEmpty());
  const int width = problem.input.cameras[0].image_size[0];
  for (View& view : problem.input.cameras[0].views) {
    for (Observation& o : view.observations) o.values[0] = width - 1 - o.values[0];
  }
  EXPECT_THAT(CodesOf(Find(problem.input, doubts)), ElementsAre("images_mirrored"));
}

TEST(TargetCauses, NameMarkersThatHaveMoved) {
  SyntheticProblem problem = Board(7);
  problem.input.markers[33].x() += 0.002;
  problem.input.markers[61].y() -= 0.003;
  const std::vector<Finding> causes = Find(problem.input, {});
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_marker_moved"));
  EXPECT_THAT(causes[0].what, HasSubstr("marker 33 by 2 mm"));
  EXPECT_THAT(causes[0].what, HasSubstr("marker 61 by 2.97 mm"));
  EXPECT_NEAR(causes[0].value.value(), 0.003, 1e-4);
}

TEST(TargetCauses, NameATagThatHasMoved) {
  SyntheticProblem problem = Board(8);
  for (const int number : Tag(2, 1)) problem.input.markers[number].x() += 0.004;
  const std::vector<Finding> causes = Find(problem.input, Tags());
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_marker_moved"));
  EXPECT_THAT(causes[0].what, HasSubstr("tag 8 by 3.98 mm"));
}

TEST(TargetCauses, NameTagsOfAnotherSize) {
  SyntheticProblem problem = Board(9);
  for (const std::array<int, 4>& tag : {Tag(1, 0), Tag(3, 2)}) {
    Eigen::Vector3d middle(0, 0, 0);
    for (const int number : tag) middle += problem.input.markers[number] / 4;
    for (const int number : tag) {
      problem.input.markers[number] = middle + 0.8 * (problem.input.markers[number] - middle);
    }
  }
  const std::vector<Finding> causes = Find(problem.input, Tags());
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_tag_size"));
  EXPECT_NEAR(causes[0].value.value(), 0.25, 0.01);
  EXPECT_THAT(causes[0].what, HasSubstr("in place of 24"));
}

TEST(TargetCauses, NameATagWithTurnedCorners) {
  SyntheticProblem problem = Board(10);
  const std::array<int, 4> tag = Tag(2, 2);
  std::map<int, Eigen::Vector3d>& markers = problem.input.markers;
  const Eigen::Vector3d first = markers[tag[0]];
  for (size_t k = 0; k < 3; ++k) markers[tag[k]] = markers[tag[k + 1]];
  markers[tag[3]] = first;
  const std::vector<Finding> causes = Find(problem.input, Tags());
  ASSERT_THAT(CodesOf(causes), ElementsAre("target_corner_order"));
  EXPECT_THAT(causes[0].what, HasSubstr("upper left, lower left, lower right, upper right"));
}

TEST(TargetCauses, NameATagThatExistsTwice) {
  SyntheticProblem problem = Board(11);
  int frame = 0;
  for (View& view : problem.input.cameras[0].views) {
    if (frame++ % 2 != 0) continue;
    for (Observation& o : view.observations) {
      for (const int number : Tag(4, 0)) {
        if (o.marker == number) o.values[1] += 150;
      }
    }
  }
  EXPECT_THAT(CodesOf(Find(problem.input, Tags())), ElementsAre("target_ids_twice"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
