// SPDX-License-Identifier: Apache-2.0
//
// What displaced markers and tags are taken for, just below and just above each limit. The camera
// looks straight at the board: a displacement by 1 mm is one of `kPxPerMm` in each image.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

#include "assess/causes/cause.h"
#include "assess/causes/diagnose.h"
#include "tests/calib/synthetic.h"

namespace plenocal {

Cause MarkerOffsetsCause();

namespace testing {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kSide = 0.03, kPxPerMm = 2;

// Corner k of tag i; five tags in a row.
std::array<int, 4> Tag(int i) {
  const int first = 20 * (i / 5) + 2 * (i % 5);
  return {first + 10, first + 11, first + 1, first};
}

/// A board of 10 x 7 points in `frames` images, and the file's positions of its points.
class Board {
 public:
  explicit Board(unsigned seed, int frames = 12, double noise = 0.1) {
    const SyntheticProblem problem = MakeProblem(seed, {.frames = frames, .distorted = false});
    calibration_.bundle = TrueBundle(problem);
    calibration_.fits.resize(1);
    Bundle& bundle = calibration_.bundle;
    BundleCamera& camera = bundle.cameras[0];
    camera.T_camera_rig = {Eigen::Matrix3d::Identity(), Eigen::Vector3d::Zero()};
    const double z = camera.params[0] / (1e3 * kPxPerMm);
    camera.params[1] = camera.params[0];
    std::mt19937 random(seed);
    std::normal_distribution<double> error(0, noise);
    BundleObservation seen = bundle.observations.front();
    bundle.observations.clear();
    for (int f = 0; f < frames; ++f) {
      calibration_.frames.push_back(fmt::format("{:03}", f));
      RigidTransform& T = bundle.T_rig_target[static_cast<size_t>(f)];
      T = {Eigen::Matrix3d::Identity(), Eigen::Vector3d(-0.135, -0.09, z)};
      for (size_t m = 0; m < bundle.markers.size(); ++m) {
        seen.frame = f, seen.marker = static_cast<int>(m);
        double* px = seen.seen.values.data();
        camera.model->Project(
            camera.params.data(), nullptr, px, T * bundle.markers[m].position, px);
        for (int axis = 0; axis < 2; ++axis) px[axis] += error(random);
        bundle.observations.push_back(seen);
      }
    }
  }

  Eigen::Vector3d& Stated(int number) {
    return calibration_.bundle.markers[static_cast<size_t>(number)].nominal;
  }
  // Tag i is in truth as large as `size` times the stated one, and displaced from there, mm.
  void Change(int i, double size, const Eigen::Vector2d& mm) {
    Eigen::Vector3d middle(0, 0, 0);
    for (const int number : Tag(i)) middle += Stated(number) / 4;
    for (const int number : Tag(i)) {
      Stated(number) = middle + (Stated(number) - middle) / size;
      Stated(number).head<2>() -= mm / 1e3;
    }
  }
  // The images of tag i in the first frames are elsewhere, mm.
  void MoveInImages(int i, int frames, double mm) {
    for (BundleObservation& o : calibration_.bundle.observations) {
      if (o.frame < frames && std::ranges::count(Tag(i), o.marker)) {
        o.seen.values[0] += kPxPerMm * mm;
      }
    }
  }
  [[nodiscard]] std::vector<Finding> Find(int tags = 0) {
    TargetDoubts doubts;
    for (int i = 0; i < tags; ++i) doubts.quads.push_back(Tag(i));
    for (BundleMarker& marker : calibration_.bundle.markers) marker.position = marker.nominal;
    return MarkerOffsetsCause().find({.doubts = &doubts, .calibration = &calibration_});
  }

 private:
  Calibration calibration_;
};

// A median over the images has 1.2533 times the standard error of a mean; the median length of
// 2-d errors is 1.1774 sigma; ten unknowns of the smooth part take off their share of 70 markers.
TEST(DisplacedMarkers, ExceedWhatChanceDoesInOneOfTenThousandSessions) {
  double mean = 0;
  for (unsigned seed = 1; seed <= 8; ++seed) {
    Board board(seed, 12, 0.5);
    board.Stated(44).x() += 0.01;
    const std::vector<Finding> found = board.Find();
    ASSERT_EQ(found.size(), 1U);
    mean += *found[0].limit / 8;
  }
  const double of_median = 1.2 * 0.5 / std::sqrt(12) / (1e3 * kPxPerMm);
  const double expected = of_median * std::sqrt(60.0 / 70) * std::sqrt(2 * std::log(70 / 1e-4));
  EXPECT_NEAR(mean / expected, 1, 0.08);
}

// Each of 12 images has a scatter of 1.25 (per coordinate, by the median) times 0.5 px: 0.94 mm.
TEST(DisplacedMarkers, ExceedThreeTimesTheScatterInOneImage) {
  for (unsigned seed = 1; seed <= 3; ++seed) {
    for (const double mm : {0.65, 1.3}) {
      Board board(seed, 12, 0.5);
      board.Stated(44).y() -= mm / 1e3;
      EXPECT_EQ(board.Find().size(), mm < 0.94 ? 0U : 1U) << seed << " " << mm;
    }
  }
}

TEST(DisplacedMarkers, AreAllNamedUpToFive) {
  Board board(2);
  for (const int number : {3, 17, 25, 38, 52}) board.Stated(number).x() += 0.004;
  const std::vector<Finding> found = board.Find();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_THAT(found[0].what, HasSubstr(", marker 52 by "));
  EXPECT_THAT(found[0].what, EndsWith(" mm"));
}

TEST(DisplacedTags, AreOfAnotherSizeOrMovedByWhatIsMore) {
  for (const double sign : {1.0, -1.0}) {
    Board size(3);
    size.Change(7, 1.2, sign * Eigen::Vector2d(2.1, 2.1));
    EXPECT_THAT(CodesOf(size.Find(15)), ElementsAre("target_tag_size")) << sign;
    Board moved(3);
    moved.Change(7, 1.1, sign * Eigen::Vector2d(3, -3));
    EXPECT_THAT(CodesOf(moved.Find(15)), ElementsAre("target_marker_moved")) << sign;
  }
}

// The side of four corners together scatters by 0.7 times a coordinate, the place by 0.5 times.
TEST(DisplacedTags, ExceedTheScatterInOneImage) {
  for (const double mm : {0.25, 0.9}) {
    Board board(4, 12, 0.5);
    board.Change(7, 1 + 1e-3 * mm / kSide, {0, 0});
    EXPECT_EQ(board.Find(15).size(), mm < 0.47 ? 0U : 1U) << mm;
  }
}

// All that remains beside an order of the corners is less than a twentieth of the squares. Corners
// turned by one place lie a side each from the stated ones: 4 d^2 < (4 side^2 + 4 d^2) / 20.
TEST(DisplacedTags, HaveAnotherOrderOfCornersThatExplainsNearlyAll) {
  const double limit = 30 / std::sqrt(19);
  for (const double part : {0.95, 1.05}) {
    for (const double angle : {0.0, 1.5, 3.0, 4.5}) {
      Board board(5);
      std::array<Eigen::Vector3d, 4> places;
      for (size_t k = 0; k < 4; ++k) places[k] = board.Stated(Tag(7)[k]);
      for (size_t k = 0; k < 4; ++k) board.Stated(Tag(7)[k]) = places[(k + 1) % 4];
      board.Change(7, 1, part * limit * Eigen::Vector2d(std::cos(angle), std::sin(angle)));
      const std::vector<std::string> codes = CodesOf(board.Find(15));
      EXPECT_EQ(std::ranges::count(codes, "target_corner_order"), part < 1 ? 1 : 0)
          << part << " " << angle;
    }
  }
  // A displacement alone is no order.
  Board board(5);
  board.Change(7, 1, {9, 3});
  EXPECT_THAT(CodesOf(board.Find(15)), ElementsAre("target_marker_moved"));
}

// Twice: a fifth of a side at most here, half of one at least there, in two images and a fifth.
TEST(DisplacedTags, ExistTwiceWhereTheyAreHereAndThere) {
  struct Case {
    int frames, elsewhere;
    double here, there;  // mm
    bool twice;
  };
  for (const Case& each : {Case{12, 4, 5.5, 20, true},
                           Case{12, 4, 6.5, 20, false},
                           Case{12, 4, 0, 15.5, true},
                           Case{12, 4, 0, 14.5, false},
                           Case{10, 2, 0, 20, true},
                           Case{10, 8, 0, 20, true},
                           Case{5, 1, 0, 20, false},
                           Case{5, 4, 0, 20, false},
                           Case{5, 2, 0, 20, true},
                           Case{12, 2, 0, 20, false},
                           Case{12, 10, 0, 20, false}}) {
    Board board(6, each.frames);
    board.Change(7, 1, {each.here, 0});
    board.MoveInImages(7, each.elsewhere, each.there - each.here);
    const std::vector<std::string> codes = CodesOf(board.Find(15));
    EXPECT_EQ(std::ranges::count(codes, "target_ids_twice"), each.twice ? 1 : 0)
        << each.frames << " " << each.elsewhere << " " << each.here << " " << each.there;
  }
}

// The smooth part is linear from six tags on and quadratic from twelve on.
TEST(DisplacedTags, AreBesideWhatIsSmoothOverTheTarget) {
  struct Case {
    int tags;
    double linear, quadratic;
    bool found;
  };
  for (const Case& each : {Case{6, 0.03, 0, true},
                           Case{12, 0.03, 0.2, true},
                           Case{15, 0.03, 0.2, true},
                           Case{15, 0, 0, true},
                           Case{3, 0, 0, true}}) {
    for (const bool moved : {false, true}) {
      Board board(7);
      for (int number = 0; number < 70; ++number) {
        Eigen::Vector3d& p = board.Stated(number);
        const double x = p.x() - 0.1, y = p.y() - 0.1;
        p.x() += each.linear * y + each.quadratic * x * y;
        p.y() -= each.linear * x - each.quadratic * x * x;
      }
      if (moved) board.Change(1, 1, {3, -4});
      const std::vector<Finding> found = board.Find(each.tags);
      EXPECT_EQ(found.size(), moved && each.found ? 1U : 0U) << each.tags << " " << moved;
      if (!found.empty()) {
        EXPECT_THAT(found[0].what, HasSubstr(": tag "));
      }
    }
  }
}

}  // namespace TEST_FILE
}  // namespace testing
}  // namespace plenocal
