// SPDX-License-Identifier: Apache-2.0
//
// Limits, values and texts of the causes in a target, on the truth of a problem in place of a
// calibration. The board has 10 x 7 points, number 10 * row + column, 30 mm apart.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "assess/causes/cause.h"
#include "assess/causes/diagnose.h"
#include "calib/camera/corner_orders.h"
#include "tests/calib/synthetic.h"

namespace plenocal {

Cause DistanceUnitCause();
Cause ImagesMirroredCause();
Cause MarkerOffsetsCause();
Cause WrongLayoutCause();

namespace testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::StartsWith;

constexpr double kSpacing = 0.03, kNoise = 0.1;

Calibration TrueCalibration(const SyntheticProblem& problem) {
  Calibration calibration;
  calibration.bundle = TrueBundle(problem);
  for (const auto& [frame, pose] : problem.T_rig_target) calibration.frames.push_back(frame);
  calibration.fits.resize(problem.params.size());
  return calibration;
}

// Corner k of the tag at a column 0 to 4 and a row 0 to 2.
std::array<int, 4> Tag(int column, int row) {
  const int first = 20 * row + 2 * column;
  return {first + 10, first + 11, first + 1, first};
}

TargetDoubts Tags(int count = 15) {
  TargetDoubts doubts;
  for (int i = 0; i < count; ++i) doubts.quads.push_back(Tag(i % 5, i / 5));
  return doubts;
}

/// True images of a target whose file states other positions.
struct MovedTarget {
  explicit MovedTarget(unsigned seed, int frames = 12)
      : calibration(TrueCalibration(MakeProblem(seed, {.frames = frames, .noise = kNoise}))) {}

  Eigen::Vector3d& Stated(int number) { return calibration.bundle.markers.at(number).nominal; }
  [[nodiscard]] std::vector<Finding> Find(const TargetDoubts& doubts = {}) {
    // Without a tolerance markers are where the file states.
    if (calibration.bundle.marker_freedom.IsRigid()) {
      for (BundleMarker& marker : calibration.bundle.markers) marker.position = marker.nominal;
    }
    return MarkerOffsetsCause().find({.doubts = &doubts, .calibration = &calibration});
  }

  Calibration calibration;
};

TEST(MarkerOffsets, AreNoneOfTheTruth) {
  for (unsigned seed = 40; seed < 44; ++seed) {
    EXPECT_THAT(MovedTarget(seed).Find(), IsEmpty());
    EXPECT_THAT(MovedTarget(seed).Find(Tags()), IsEmpty());
  }
}

TEST(MarkerOffsets, HaveTheLengthOfTheDisplacement) {
  for (const double sign : {1.0, -1.0}) {
    MovedTarget target(41);
    target.Stated(33) += sign * Eigen::Vector3d(0.003, -0.004, 0);
    const std::vector<Finding> found = target.Find();
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].code, "target_marker_moved");
    EXPECT_EQ(found[0].role, FindingRole::kTargetResiduals);
    EXPECT_EQ(found[0].grade, Grade::kUsable);
    EXPECT_NEAR(*found[0].value, 0.005, 1e-4);
    // Rayleigh's limit of 70 markers is 5.2 sigmas, here of medians over 12 views of 0.03 mm.
    EXPECT_GT(*found[0].limit, 2e-5);
    EXPECT_LT(*found[0].limit, 3e-4);
    EXPECT_EQ(found[0].what,
              fmt::format("not where the target's file states, relative to all others: marker 33 "
                          "by {:.3g} mm",
                          1e3 * *found[0].value));
  }
}

TEST(MarkerOffsets, NameFiveMarkersAndCountTheRest) {
  MovedTarget target(42);
  for (const int number : {3, 17, 25, 38, 44, 52}) target.Stated(number).x() += 0.004;
  target.Stated(66).y() += 0.005;
  const std::vector<Finding> found = target.Find();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_NEAR(*found[0].value, 0.005, 2e-4);
  EXPECT_THAT(found[0].what, HasSubstr(": marker 3 by "));
  EXPECT_THAT(found[0].what, HasSubstr(", marker 44 by "));
  EXPECT_THAT(found[0].what, ::testing::EndsWith(" mm and 2 more"));
}

TEST(MarkerOffsets, AreBeyondSixTolerances) {
  // The estimated positions are the true ones.
  for (const double length : {0.0027, 0.0033}) {
    MovedTarget target(43);
    target.calibration.bundle.marker_freedom = MarkerFreedom::FromSigma(0.0005);
    target.Stated(27).x() -= length;
    const std::vector<Finding> found = target.Find();
    ASSERT_EQ(found.size(), length > 0.003 ? 1U : 0U);
    if (!found.empty()) {
      EXPECT_NEAR(*found[0].value, length, 2e-4);
    }
  }
}

TEST(MarkerOffsets, AreLocal) {
  MovedTarget target(44);
  for (BundleMarker& marker : target.calibration.bundle.markers) {
    const Eigen::Vector3d p = marker.nominal;
    marker.nominal.x() += 0.01 * p.x() + 0.05 * p.x() * p.y();
    marker.nominal.y() += 0.02 * p.x() - 0.03 * p.y() * p.y();
  }
  EXPECT_THAT(target.Find(), IsEmpty());
  target.Stated(36).y() += 0.003;
  EXPECT_THAT(CodesOf(target.Find()), ElementsAre("target_marker_moved"));
}

TEST(MarkerOffsets, NeedViewsAndPiecesThatAgree) {
  for (const int views : {2, 3}) {
    MovedTarget target(45);
    target.Stated(33).x() += 0.004;
    std::erase_if(target.calibration.bundle.observations,
                  [&](const auto& o) { return o.marker == 33 && o.frame >= views; });
    EXPECT_EQ(target.Find().size(), views < 3 ? 0U : 1U) << views;
  }
  MovedTarget target(46);
  for (const int tags : {2, 3}) {
    for (const int number : Tag(0, 0)) target.Stated(number).x() = 0.004 + kSpacing * (number % 10);
    EXPECT_EQ(target.Find(Tags(tags)).size(), tags < 3 ? 0U : 1U) << tags;
  }
}

TEST(MarkerOffsets, OfATagAreThoseOfItsCorners) {
  MovedTarget target(47);
  for (const int number : Tag(3, 1)) target.Stated(number) += Eigen::Vector3d(-0.004, 0.003, 0);
  const std::vector<Finding> found = target.Find(Tags());
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "target_marker_moved");
  EXPECT_NEAR(*found[0].value, 0.005, 1e-4);
  EXPECT_EQ(found[0].what,
            fmt::format("not where the target's file states, relative to all others: tag 9 by "
                        "{:.3g} mm",
                        1e3 * *found[0].value));
}

TEST(MarkerOffsets, OfATagThatIsSeenInPart) {
  for (const int corners : {2, 3}) {
    MovedTarget target(48);
    for (const int number : Tag(3, 1)) target.Stated(number).y() += 0.004;
    std::erase_if(target.calibration.bundle.observations, [&](const auto& o) {
      return o.marker == Tag(3, 1)[3] || (corners == 2 && o.marker == Tag(3, 1)[0]);
    });
    EXPECT_EQ(target.Find(Tags()).size(), corners == 3 ? 1U : 0U);
  }
}

TEST(MarkerOffsets, ShowTagsOfAnotherSize) {
  // True sides of 30 mm.
  for (const double stated : {0.024, 0.036}) {
    MovedTarget target(49);
    const std::array<int, 4> tag = Tag(2, 1);
    Eigen::Vector3d middle(0, 0, 0);
    for (const int number : tag) middle += target.Stated(number) / 4;
    for (const int number : tag) {
      target.Stated(number) = middle + stated / kSpacing * (target.Stated(number) - middle);
    }
    const std::vector<Finding> found = target.Find(Tags());
    ASSERT_EQ(found.size(), 1U);
    EXPECT_EQ(found[0].code, "target_tag_size");
    EXPECT_EQ(found[0].role, FindingRole::kTargetResiduals);
    EXPECT_EQ(found[0].grade, Grade::kBad);
    const double change = (kSpacing - stated) / stated;
    EXPECT_NEAR(*found[0].value, std::abs(change), 0.005);
    EXPECT_EQ(found[0].what,
              fmt::format("other sizes than the target's file states, relative to the other tags: "
                          "tag 8 has sides of {:.4g} mm in place of {:.4g}",
                          1e3 * stated * (1 + std::copysign(*found[0].value, change)),
                          1e3 * stated));
  }
}

TEST(MarkerOffsets, ShowEachOrderOfCorners) {
  for (size_t i = 0; i < kCornerOrders.size(); ++i) {
    MovedTarget target(50);
    const std::array<int, 4> tag = Tag(1, 1);
    std::array<Eigen::Vector3d, 4> places;
    for (size_t k = 0; k < 4; ++k) places[k] = target.Stated(tag[k]);
    for (size_t k = 0; k < 4; ++k) target.Stated(tag[kCornerOrders[i][k]]) = places[k];
    const std::vector<Finding> found = target.Find(Tags());
    ASSERT_EQ(found.size(), 1U) << i;
    EXPECT_EQ(found[0].code, "target_corner_order");
    EXPECT_EQ(found[0].role, FindingRole::kTargetCause);
    EXPECT_EQ(found[0].grade, Grade::kBad);
    EXPECT_THAT(found[0].what,
                StartsWith("corners in another order than the target's file states: tag 8 ("));
  }
}

TEST(MarkerOffsets, ShowTagsThatExistTwice) {
  // Elsewhere in some of 12 images, by more than half a side.
  for (const int elsewhere : {1, 2, 3, 6, 9, 10, 11}) {
    MovedTarget target(51);
    const std::array<int, 4> tag = Tag(4, 0);
    for (BundleObservation& seen : target.calibration.bundle.observations) {
      if (seen.frame < elsewhere && std::ranges::count(tag, seen.marker)) {
        seen.seen.values[0] += 100, seen.seen.values[1] += 110;
      }
    }
    const std::vector<Finding> found = target.Find(Tags());
    // At least two and a fifth of the images, here and there.
    const bool twice = elsewhere >= 3 && elsewhere <= 9;
    std::vector<std::string> codes = CodesOf(found);
    EXPECT_EQ(std::ranges::count(codes, "target_ids_twice"), twice ? 1 : 0) << elsewhere;
    if (!twice) continue;
    EXPECT_EQ(found[0].role, FindingRole::kTargetResiduals);
    EXPECT_EQ(found[0].grade, Grade::kBad);
    EXPECT_EQ(*found[0].value, elsewhere);
    EXPECT_EQ(*found[0].limit, 2);
    EXPECT_EQ(found[0].what,
              fmt::format("now in one place, now in another: tag 4 (elsewhere in {} of 12 images)",
                          elsewhere));
  }
}

// With a board on which most markers have moved nothing is certain.
TEST(MarkerOffsets, AreOfAtMostHalfOfThePieces) {
  for (const int moved : {2, 3}) {
    MovedTarget target(52);
    for (int i = 0; i < moved; ++i) {
      for (const int number : Tag(i, 0)) target.Stated(number).y() += i % 2 == 0 ? 0.005 : -0.006;
    }
    TargetDoubts doubts = Tags(5);
    EXPECT_LE(target.Find(doubts).size(), moved > 2 ? 0U : 1U) << moved;
  }
}

// Markers of a size before a camera at a distance.
std::vector<Finding> FindUnit(double size, double distance, const TargetDoubts& doubts = {}) {
  Calibration calibration;
  for (const double part : {0.5, 1.0, 1.1}) {
    calibration.bundle.T_rig_target.push_back(
        {Eigen::Matrix3d::Identity(), distance * part * Eigen::Vector3d(0, 0.6, -0.8)});
  }
  const std::map<int, Eigen::Vector3d> markers{
      {1, {1, 2, 3}}, {2, {1, 2, 3}}, {3, Eigen::Vector3d(1 + 0.6 * size, 2 - 0.8 * size, 3)}};
  return DistanceUnitCause().find(
      {.markers = &markers, .doubts = &doubts, .calibration = &calibration});
}

TEST(DistanceUnit, IsTheFirstThatMakesSizeAndDistanceUsual) {
  struct Case {
    double size, distance;
    const char *unit, *factor;
  };
  for (const Case& each : {Case{30, 100, "in inches", "0.0254"},
                           Case{300, 1000, "in millimetres", "0.001"},
                           Case{10, 1500, "in centimetres", "0.01"},
                           Case{4.01, 4.01, "in inches", "0.0254"},
                           Case{0.005, 0.02, "39.3701 times too small", "39.3701"},
                           Case{0.0099, 0.049, "39.3701 times too small", "39.3701"},
                           Case{0.0005, 0.002, "1000 times too small", "1000"},
                           Case{0.009, 0.0006, "100 times too small", "100"}}) {
    const std::vector<Finding> found = FindUnit(each.size, each.distance);
    ASSERT_EQ(found.size(), 1U) << each.size << " " << each.distance;
    const bool large = each.size > 1;
    EXPECT_EQ(found[0].code, "target_scale");
    EXPECT_EQ(found[0].role, FindingRole::kTargetCause);
    EXPECT_EQ(found[0].grade, Grade::kBad);
    EXPECT_NEAR(*found[0].value, each.distance, 1e-9);
    EXPECT_EQ(*found[0].limit, large ? 30 : 0.05);
    EXPECT_EQ(
        found[0].what,
        fmt::format("the target is {:.3g} m across and was {:.3g} m away: lengths in its file "
                    "seem to be {}",
                    each.size,
                    each.distance,
                    each.unit));
    EXPECT_EQ(found[0].remedy,
              fmt::format("lengths in the target's file are metres: multiply them by {}; or was "
                          "'unknown' meant? Then write it in place of the length{}",
                          each.factor,
                          large ? ", for which 1 often stands" : ""));
  }
}

TEST(DistanceUnit, IsTrustedWhereLengthsAreUsualOrStated) {
  for (const auto& [size, distance] :
       std::vector<std::pair<double, double>>{{3.99, 100},
                                              {30, 3.99},
                                              {0.3, 1},
                                              {0.0101, 0.02},
                                              {0.005, 0.051},
                                              // no unit makes both usual
                                              {5000, 5000},
                                              {5, 40000},
                                              {1e-6, 1e-6}}) {
    EXPECT_THAT(FindUnit(size, distance), IsEmpty()) << size << " " << distance;
  }
  TargetDoubts doubts;
  doubts.unit_is_stated = true;
  EXPECT_THAT(FindUnit(300, 1000, doubts), IsEmpty());
  doubts.unknown = "square";
  const std::vector<Finding> found = FindUnit(0.3, 1, doubts);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "target_size_unknown");
  EXPECT_EQ(found[0].grade, Grade::kGood);
  EXPECT_EQ(found[0].what,
            "All lengths are in units of the target's 'square', which is unknown: 1 m in this "
            "result is one square. Intrinsics do not depend on it.");
  EXPECT_EQ(found[0].remedy, "To have lengths in metres, measure 'square' and state it.");
}

// Two cameras, of which the second sees the printed side from behind in `behind` of 20 frames.
std::vector<Finding> FindMirrored(int behind, const std::function<void(Bundle*)>& change = {}) {
  Calibration calibration =
      TrueCalibration(MakeProblem(60, {.cameras = 2, .frames = 20, .noise = kNoise}));
  Bundle& bundle = calibration.bundle;
  TargetDoubts doubts;
  for (const BundleMarker& marker : bundle.markers) {
    if (marker.number < 40) doubts.normals[marker.number] = Eigen::Vector3d(0, 0, -1);
  }
  std::erase_if(bundle.observations, [&](const BundleObservation& seen) {
    return (seen.camera == 0) == (seen.frame < behind);
  });
  for (int f = 0; f < behind; ++f) {
    RigidTransform& T = bundle.T_rig_target[static_cast<size_t>(f)];
    const Eigen::Vector3d middle = T * Eigen::Vector3d(0.135, 0.09, 0);
    T.R = T.R * ExpRotation(Eigen::Vector3d(0, std::numbers::pi, 0));
    T.t = middle - T.R * Eigen::Vector3d(0.135, 0.09, 0);
  }
  if (change) change(&bundle);
  return ImagesMirroredCause().find({.doubts = &doubts, .calibration = &calibration});
}

TEST(ImagesMirrored, AreThoseOfACameraThatSeesTheBackInNineOfTenViews) {
  const std::vector<Finding> found = FindMirrored(19);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "images_mirrored");
  EXPECT_EQ(found[0].role, FindingRole::kCause);
  EXPECT_EQ(found[0].grade, Grade::kBad);
  EXPECT_THAT(found[0].cameras, ElementsAre("cam1"));
  EXPECT_EQ(*found[0].value, 1);
  EXPECT_EQ(*found[0].limit, 0.9);
  EXPECT_EQ(found[0].what,
            "cam1: its images are mirrored: they show the printed side of the target from behind "
            "(19 of 19 images).");
  EXPECT_THAT(FindMirrored(0), IsEmpty());
  // All points of camera 0, of 18 and 19 images from behind of 20.
  const auto all_of_one = [](Bundle* bundle) {
    bundle->cameras.resize(1);
    for (BundleObservation& seen : bundle->observations) seen.camera = 0;
  };
  EXPECT_THAT(FindMirrored(18, all_of_one), IsEmpty());
  const std::vector<Finding> most = FindMirrored(19, all_of_one);
  ASSERT_EQ(most.size(), 1U);
  EXPECT_EQ(*most[0].value, 0.95);
  EXPECT_THAT(most[0].what, HasSubstr("(19 of 20 images)."));
}

TEST(ImagesMirrored, AreJudgedByUsedPointsWithAPrintedSide) {
  EXPECT_THAT(FindMirrored(19,
                           [](Bundle* bundle) {
                             for (BundleObservation& seen : bundle->observations)
                               seen.used = seen.marker >= 40;
                           }),
              IsEmpty());
  EXPECT_THAT(FindMirrored(19,
                           [](Bundle* bundle) {
                             for (BundleObservation& seen : bundle->observations)
                               seen.used = seen.marker == 39;
                           }),
              ::testing::SizeIs(1));
}

// Rows of `columns` points.
CandidatePlaces Rows(int columns, int count = 70) {
  CandidatePlaces places;
  for (int i = 0; i < count; ++i) {
    places[i] = {Eigen::Vector3d(kSpacing * (i % columns), kSpacing * (i / columns), 0)};
  }
  return places;
}

TargetHypothesis RowsOf(int columns, int count = 70) {
  return {.code = "target_layout",
          .what = fmt::format("rows of {}", columns),
          .remedy = "set columns",
          .places = [columns, count] { return Rows(columns, count); }};
}

std::vector<Finding> FindLayout(const SyntheticProblem& problem, const TargetDoubts& doubts) {
  return WrongLayoutCause().find(
      {.inputs = &problem.input.cameras, .markers = &problem.input.markers, .doubts = &doubts});
}

SyntheticProblem WithRows(unsigned seed, int columns, int frames = 2) {
  SyntheticProblem problem = MakeProblem(seed, {.frames = frames, .noise = kNoise});
  for (auto& [number, p] : problem.input.markers) p = Rows(columns).at(number).front();
  return problem;
}

TEST(WrongLayouts, AreNamedByWhatFitsBest) {
  const SyntheticProblem problem = WithRows(61, 7);
  const std::vector<Finding> found =
      FindLayout(problem, {{RowsOf(5), RowsOf(10), RowsOf(14)}, {}, {}});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].code, "target_layout");
  EXPECT_EQ(found[0].role, FindingRole::kTargetCause);
  EXPECT_EQ(found[0].grade, Grade::kBad);
  EXPECT_NEAR(*found[0].limit, std::sqrt(2), 1e-12);
  EXPECT_GT(*found[0].value, 100);
  EXPECT_EQ(found[0].what,
            fmt::format("rows of 10: the points of the images then fit {:.0f} times better than to "
                        "the target's file",
                        *found[0].value));
  EXPECT_EQ(found[0].remedy, "set columns");
}

TEST(WrongLayouts, ExplainFourFifthsOfThePoints) {
  const SyntheticProblem problem = WithRows(62, 7);
  EXPECT_EQ(FindLayout(problem, {{RowsOf(10, 60)}, {}, {}}).size(), 1U);
  EXPECT_THAT(FindLayout(problem, {{RowsOf(10, 50)}, {}, {}}), IsEmpty());
  EXPECT_THAT(FindLayout(problem, {{RowsOf(9)}, {}, {}}), IsEmpty());
  EXPECT_THAT(FindLayout(problem, {}), IsEmpty());
  EXPECT_THAT(FindLayout(WithRows(62, 10), {{RowsOf(7), RowsOf(10)}, {}, {}}), IsEmpty());
}

// Pairs of columns one part apart, the pairs `gap` parts apart: 1 in truth.
TEST(WrongLayouts, EstimateANumberWithItsStandardError) {
  for (const double stated : {0.4, 1.1}) {
    SyntheticProblem problem = MakeProblem(63, {.frames = 3, .noise = kNoise});
    TargetNumber gap{.code = "target_spacing",
                     .key = "spacing",
                     .meaning = "gap / size",
                     .stated = stated,
                     .least = 0.1,
                     .most = 4,
                     .by_number = {}};
    for (auto& [number, p] : problem.input.markers) {
      gap.by_number[number] = Eigen::Vector3d(kSpacing * (number % 10 / 2), 0, 0);
      p += (stated - 1) * gap.by_number[number];
    }
    const std::vector<Finding> found = FindLayout(problem, {{}, {gap}, {}});
    ASSERT_EQ(found.size(), 1U) << stated;
    EXPECT_EQ(found[0].code, "target_spacing");
    EXPECT_EQ(found[0].grade, Grade::kBad);
    EXPECT_EQ(found[0].role, FindingRole::kTargetCause);
    EXPECT_NEAR(*found[0].value, 1, 0.003);
    EXPECT_EQ(*found[0].limit, stated);
    double value = 0, sigma = 0;
    ASSERT_EQ(std::sscanf(found[0].what.c_str(),
                          "the images show a spacing (gap / size) of %lf +- %lf",
                          &value,
                          &sigma),
              2);
    // Noise of 0.1 px in some 60 px a part, over 210 points.
    EXPECT_GT(sigma, 1e-4);
    EXPECT_LT(sigma, 2e-3);
    EXPECT_NEAR(*found[0].value, 1, 4 * sigma);
    const int digits = static_cast<int>(std::ceil(-std::log10(2 * sigma)));
    EXPECT_EQ(found[0].what,
              fmt::format("the images show a spacing (gap / size) of {:.{}f} +- {:.1g}, the "
                          "target's file states {:g}",
                          *found[0].value,
                          digits,
                          sigma,
                          stated));
    EXPECT_EQ(
        found[0].remedy,
        fmt::format(
            "set spacing: {:.{}f} in the target's file, or measure it", *found[0].value, digits));
  }
}

TEST(WrongLayouts, OfASolidTargetAreTestedByACamera) {
  SyntheticProblem problem = MakeProblem(
      64, {.shape = TargetShape::kCorner, .frames = 3, .noise = kNoise, .partial = 0.7});
  const std::map<int, Eigen::Vector3d> truth = problem.input.markers;
  const TargetHypothesis hypothesis{
      .code = "target_layout", .what = "as built", .remedy = "build", .places = [truth] {
        CandidatePlaces places;
        for (const auto& [number, p] : truth) places[number] = {p};
        return places;
      }};
  EXPECT_THAT(FindLayout(problem, {{hypothesis}, {}, {}}), IsEmpty());
  for (auto& [number, p] : problem.input.markers) {
    if (number >= 1000 && number % 2 == 0) p += Eigen::Vector3d(0.02, 0.01, -0.02);
  }
  const std::vector<Finding> found = FindLayout(problem, {{hypothesis}, {}, {}});
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0].what, StartsWith("as built: the points of the images then fit "));
}

TEST(WrongLayouts, ShowTwoTargetsInTwoImagesAndATenth) {
  for (const int twice : {1, 2}) {
    SyntheticProblem problem = MakeProblem(65, {.frames = 4, .noise = kNoise});
    for (int v = 0; v < twice; ++v) {
      for (Observation& o : problem.input.cameras[0].views[static_cast<size_t>(v)].observations) {
        if (o.marker * 13 % 10 < 4) o.values[0] += 0.4 * o.values[1] + 200;
      }
    }
    const std::vector<Finding> found = FindLayout(problem, {});
    ASSERT_EQ(found.size(), twice < 2 ? 0U : 1U);
    if (found.empty()) continue;
    EXPECT_EQ(found[0].code, "target_ids_twice");
    EXPECT_EQ(found[0].role, FindingRole::kTargetResiduals);
    EXPECT_EQ(found[0].grade, Grade::kBad);
    EXPECT_EQ(*found[0].value, 2);
    EXPECT_EQ(*found[0].limit, 2);
    EXPECT_EQ(found[0].what,
              "in 2 of 4 images the points lie on two targets: a part of them fits the stated "
              "target in one place, the rest in another");
  }
}

TEST(FindCauses, NamesTheCameraInFindingsOfOne) {
  CameraTraits traits;
  traits["a"].orientation = 6;
  CauseEvidence evidence{.traits = &traits};
  std::vector<Finding> found = FindCauses(CauseStage::kImageFile, evidence);
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0].what, StartsWith("one image has"));
  EXPECT_THAT(found[0].cameras, IsEmpty());
  evidence.name = "left";
  found = FindCauses(CauseStage::kImageFile, evidence);
  EXPECT_THAT(found[0].what, StartsWith("left: one image has"));
  EXPECT_THAT(found[0].cameras, ElementsAre("left"));
}

// The layout is tested alone, then what a calibration shows, worst first.
TEST(FindTargetCauses, AreOfTheLayoutOrOfTheCalibration) {
  SyntheticProblem problem = WithRows(66, 7);
  const Calibration calibration = TrueCalibration(problem);
  TargetDoubts doubts{{RowsOf(10)}, {}, {}};
  doubts.unknown = "square";
  EXPECT_THAT(CodesOf(FindTargetCauses(problem.input, doubts, &calibration)),
              ElementsAre("target_layout"));
  doubts.hypotheses.clear();
  EXPECT_THAT(FindTargetCauses(problem.input, doubts, nullptr), IsEmpty());
  for (const BundleMarker& marker : calibration.bundle.markers) {
    doubts.normals[marker.number] = Eigen::Vector3d(0, 0, 1);
  }
  problem = WithRows(66, 10, 4);
  const Calibration right = TrueCalibration(problem);
  EXPECT_THAT(CodesOf(FindTargetCauses(problem.input, doubts, &right)),
              ElementsAre("images_mirrored", "target_size_unknown"));
}

}  // namespace TEST_FILE
}  // namespace testing
}  // namespace plenocal
