// SPDX-License-Identifier: Apache-2.0
//
// Edges of printed shapes along rays, where the markers' true positions put them.
#include "apps/simulate/targets/target_surface.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "apps/simulate/spec/random.h"
#include "calib/io/yaml.h"
#include "targets/target.h"
#include "tests/apps/simulate/small_scene.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr float kPaper = 1;
constexpr double kMiddle = (kPaper + PosedSurface::kInk) / 2;

Target Read(const std::string& text) {
  return ReadTarget(YamlNode::Parse("plenocal: 1\n" + text, "t"));
}

TrueTarget Displaced(const Target& nominal, double size) {
  TrueTarget made{.markers = nominal.markers, .normals = {}};
  Random random(4, "displaced");
  for (auto& [number, position] : made.markers) {
    for (double& x : position) x += random.Uniform(-size, size);
  }
  return made;
}

// A target at a pose, asked by points of its frame.
struct Seen {
  TargetSurface surface;
  RigidTransform T_camera_target;
  PosedSurface posed;

  Seen(TargetSurface of, const RigidTransform& T)
      : surface(std::move(of)), T_camera_target(T), posed(surface, T) {}
  [[nodiscard]] double At(const Vector3d& point, float width = 0) const {
    const Vector3d p = T_camera_target * point;
    return posed.Radiance(
        Vector3f::Zero(), p.cast<float>(), {.at_origin = width, .by_distance = 0});
  }
  // Where the brightness passes the middle of ink and paper between two points, as a share.
  [[nodiscard]] double Edge(Vector3d from, Vector3d to) const {
    const bool rises = At(from) < kMiddle;
    EXPECT_NE(rises, At(to) < kMiddle);
    double low = 0, high = 1;
    while (high - low > 1e-5) {
      const double middle = (low + high) / 2;
      ((At(from + middle * (to - from)) < kMiddle) == rises ? low : high) = middle;
    }
    return low;
  }
};

// Before the front of boards, whose z points away.
RigidTransform Front(double distance) {
  return {ExpRotation({0.3, -0.25, 0.4}), {-0.03, -0.02, distance}};
}
// Before the front of tags, whose z points to the viewer.
RigidTransform FrontOfTags(double distance) {
  return {ExpRotation({0.3, -0.25, 0.4}) * Vector3d(1, -1, -1).asDiagonal(),
          {0.02, 0.01, distance}};
}

TEST(TargetSurface, OfAChessboardHasItsEdgesBetweenTheTrueCorners) {
  constexpr double kSquare = 0.03;
  constexpr int kColumns = 4, kRows = 3;
  const Target nominal = Read("type: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n");
  const TrueTarget made = Displaced(nominal, 0.001);
  const Seen seen(TargetSurface(nominal, made, 1), Front(0.5));
  const auto corner = [&](int column, int row) {
    // Beyond the outermost markers nodes move with their neighbours.
    const int x = std::clamp(column, 0, kColumns - 1), y = std::clamp(row, 0, kRows - 1);
    return Vector3d(made.markers.at(y * kColumns + x) + kSquare * Vector3d(column - x, row - y, 0));
  };
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const Vector3d q = corner(column, row);
      const bool black = (column + row) % 2 == 0;  // up and to the left
      for (const auto& [x, y] : {std::pair{1, 1}, {1, -1}, {-1, 1}, {-1, -1}}) {
        const Vector3d inside =
            q + 0.1 * (corner(column + x, row) - q) + 0.1 * (corner(column, row + y) - q);
        EXPECT_NEAR(seen.At(inside), (x * y > 0) == black ? PosedSurface::kInk : kPaper, 0.005);
      }
      // Points of the four edges, between points 3 mm to both sides.
      for (const auto& [x, y] : {std::pair{1, 0}, {-1, 0}, {0, 1}, {0, -1}}) {
        for (const double share : {0.2, 0.5, 0.8}) {
          const Vector3d at = q + share * (corner(column + x, row + y) - q);
          const Vector3d across = 0.003 * Vector3d(y, x, 0);
          EXPECT_NEAR(seen.Edge(at - across, at + across), 0.5, 0.04) << column << row << x << y;
        }
      }
    }
  }
  // Outside of the squares: a quiet zone of half a square, then nothing.
  EXPECT_NEAR(seen.At({-1.25 * kSquare, 0, 0}), kPaper, 0.005);
  EXPECT_EQ(seen.At({-1.6 * kSquare, 0, 0}), Surface::kBackground);
  EXPECT_NEAR(seen.At({4.4 * kSquare, 0, 0}), kPaper, 0.005);
  EXPECT_EQ(seen.At({4.55 * kSquare, 0, 0}), Surface::kBackground);
  EXPECT_EQ(seen.At({0, -1.6 * kSquare, 0}), Surface::kBackground);
  EXPECT_NEAR(seen.At({0, 3.4 * kSquare, 0}), kPaper, 0.005);
  EXPECT_EQ(seen.At({0, 3.55 * kSquare, 0}), Surface::kBackground);
}

TEST(TargetSurface, OfCirclesHasEachDiscAroundItsMarker) {
  const Target nominal =
      Read("type: circles\ncolumns: 3\nrows: 2\nspacing: 0.02\npattern: symmetric\n");
  const double radius = DrawTarget(nominal)[0].black_discs[0].radius;
  const TrueTarget made = Displaced(nominal, 0.001);
  const Seen seen(TargetSurface(nominal, made, 1), Front(0.3));
  for (const auto& [number, centre] : made.markers) {
    EXPECT_NEAR(seen.At(centre), PosedSurface::kInk, 0.005);
    for (int k = 0; k < 8; ++k) {
      const Vector3d out(std::cos(0.8 * k), std::sin(0.8 * k), 0);
      EXPECT_NEAR(seen.Edge(centre + 0.9 * radius * out, centre + 1.1 * radius * out), 0.5, 0.06);
    }
  }
}

const std::string kTwoTags =
    "type: apriltag\nfamily: tag36h11\ntags:\n"
    "  - {id: 0, corners: [[-0.1, -0.05, 0], [0, -0.05, 0], [0, 0.05, 0], [-0.1, 0.05, 0]]}\n"
    "  - {id: 5, corners: [[0.03, -0.04, 0], [0.13, -0.04, 0], [0.13, 0.06, 0], [0.03, 0.06, 0]]}\n";

TEST(TargetSurface, OfTagsHasTheirOutlinesBetweenTheTrueCorners) {
  const Target nominal = Read(kTwoTags);
  const TrueTarget made = MakeTarget(nominal, 0.001, TagErrors::kCorners, 2);
  const Seen seen(TargetSurface(nominal, made, 1), FrontOfTags(0.6));
  for (const int id : {0, 5}) {
    Vector3d middle = Vector3d::Zero();
    std::array<Vector3d, 4> corners;
    for (int k = 0; k < 4; ++k)
      middle += (corners[static_cast<size_t>(k)] = made.markers.at(4 * id + k)) / 4;
    for (size_t k = 0; k < 4; ++k) {
      for (const double share : {0.03, 0.5, 0.97}) {
        const Vector3d at = corners[k] + share * (corners[(k + 1) % 4] - corners[k]);
        const Vector3d out =
            0.003 * ((corners[k] + corners[(k + 1) % 4]) / 2 - middle).normalized();
        EXPECT_LT(seen.At(at - out), 0.06);
        EXPECT_NEAR(seen.Edge(at - out, at + out), 0.5, 0.02);
      }
    }
  }
  // The board around the papers is grey with spots.
  Digest digest;
  double least = 1, most = 0;
  for (int i = 0; i < 30; ++i) {
    const double grey = seen.At({-0.12 + 0.008 * i, 0.1, 0});
    least = std::min(least, grey), most = std::max(most, grey);
    digest.Add(grey);
  }
  EXPECT_TRUE(least > 0.1 && most < 0.6 && most - least > 0.05);
  EXPECT_NEAR(digest.Sum(), -0.37045, 1e-3);
  // The board reaches half a tag's side beyond the papers.
  const double rim = 0.05, reach = DrawTarget(nominal)[0].paper.sizes().x() + 2 * rim;
  double length = 0;
  for (double x = -0.4; x < 0.4; x += 0.001)
    length += seen.At({x, 0, 0}) == Surface::kBackground ? 0 : 0.001;
  EXPECT_NEAR(length, reach, 0.003);
}

TEST(TargetSurface, HasAFrontAndABack) {
  const Target nominal = Read("type: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n");
  const TargetSurface surface(nominal, {nominal.markers, {}}, 1);
  const RigidTransform T = Front(0.5);
  const PosedSurface front(surface, T);
  const Vector3f p = (T * Vector3d(0.01, 0.02, 0)).cast<float>();
  EXPECT_EQ(front.FaceOf(Vector3f::Zero(), p).first, 0);
  EXPECT_NEAR(front.FaceOf(Vector3f::Zero(), p).second, 1, 1e-6);
  EXPECT_NEAR(front.FaceOf(Vector3f::Zero(), 2 * p).second, 0.5, 1e-6);
  EXPECT_NEAR(front.FaceOf(0.5 * p, p).second, 0.5, 1e-6);
  EXPECT_EQ(front.FaceOf(Vector3f::Zero(), -p).first, -1);
  EXPECT_EQ(front.FaceOf(Vector3f::Zero(), Vector3f(1, 0, 0.1f)).first, -1);
  // From behind.
  EXPECT_EQ(front.FaceOf(2 * p, -p), (std::pair{-1, 0.f}));
  EXPECT_EQ(front.Radiance(2 * p, -p, {}), PosedSurface::kBack);
  EXPECT_EQ(front.Radiance(2 * p, p, {}), Surface::kBackground);
}

TEST(TargetSurface, OfSeveralBoardsHidesTheFartherOnes) {
  const Target chess = Read("type: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n");
  const Target discs =
      Read("type: circles\ncolumns: 3\nrows: 2\nspacing: 0.02\npattern: symmetric\n");
  const RigidTransform behind{ExpRotation({0, 0, 0.3}), {0.02, 0.01, 0.1}};
  for (const bool nearer_first : {false, true}) {
    TargetSurface surface(
        nearer_first ? chess : discs, {(nearer_first ? chess : discs).markers, {}}, 1);
    const RigidTransform second = nearer_first ? behind : behind.Inverse();
    surface.Append(
        TargetSurface(
            nearer_first ? discs : chess, {(nearer_first ? discs : chess).markers, {}}, 1),
        second);
    const RigidTransform T_camera_chess{Eigen::Matrix3d::Identity(), {0, 0, 0.5}};
    const PosedSurface posed(surface, nearer_first ? T_camera_chess : T_camera_chess * behind);
    // On the middle of a white and of a black square, a disc of the other board behind them.
    EXPECT_NEAR(posed.Radiance(Vector3f::Zero(), {0.045f, 0.015f, 0.5f}, {}), kPaper, 0.005);
    EXPECT_NEAR(
        posed.Radiance(Vector3f::Zero(), {0.015f, 0.015f, 0.5f}, {}), PosedSurface::kInk, 0.005);
    EXPECT_EQ(posed.FaceOf(Vector3f::Zero(), {0.015f, 0.015f, 0.5f}).first, nearer_first ? 0 : 1);
    // From between them.
    const Vector3d disc = T_camera_chess * (behind * discs.markers.at(4));
    const Vector3f origin(0, 0, 0.55f), direction = disc.cast<float>() - origin;
    EXPECT_NEAR(posed.Radiance(origin, direction, {}), PosedSurface::kInk, 0.005);
    EXPECT_EQ(posed.FaceOf(origin, direction).first, nearer_first ? 1 : 0);
    EXPECT_NEAR(posed.FaceOf(origin, direction).second, 1, 1e-5);
  }
}

TEST(TargetSurface, IsAsBlurredAsTheBundleOfLightIsWide) {
  const Target nominal = Read("type: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n");
  const TargetSurface surface(nominal, {nominal.markers, {}}, 1);
  const PosedSurface posed(surface, {Eigen::Matrix3d::Identity(), {0, 0, 0.5}});
  constexpr double kTexel = 0.03 / 96;
  // Length over which the brightness changes at the edge x = 0.03 m; more than twice a texel of a
  // level makes it use the next one.
  const auto blur = [&](const Spread& spread) {
    double length = 0;
    for (double x = 0.02; x < 0.04; x += 1e-5) {
      const float value =
          posed.Radiance(Vector3f::Zero(), {static_cast<float>(x), 0.015f, 0.5f}, spread);
      length += value > 0.05 && value < 0.99 ? 1e-5 : 0;
    }
    return length / kTexel;
  };
  const auto width = [&](double texels) { return Spread{static_cast<float>(texels * kTexel), 0}; };
  const double fine = blur(width(0));
  EXPECT_TRUE(fine > 0.8 && fine < 2.1) << fine;
  EXPECT_EQ(blur(width(1.99)), fine);
  for (const double level : {1, 2, 3, 4}) {
    const double texel = std::exp2(level);
    const double found = blur(width(1.01 * texel));
    EXPECT_TRUE(found > 0.8 * texel && found < 2.1 * texel) << found;
    EXPECT_EQ(blur(width(1.99 * texel)), found);
  }
  // By the distance too, which counts in lengths of the direction, and whatever the sign.
  EXPECT_EQ(blur({0, static_cast<float>(3 * kTexel)}), blur(width(3)));
  EXPECT_EQ(blur({static_cast<float>(-4 * kTexel), static_cast<float>(1 * kTexel)}),
            blur(width(3)));
  // The coarsest level has 64 texels in one.
  EXPECT_EQ(posed.Radiance(Vector3f::Zero(), {0.03f, 0.015f, 0.5f}, width(65)),
            posed.Radiance(Vector3f::Zero(), {0.03f, 0.015f, 0.5f}, width(1e4)));
  EXPECT_NE(posed.Radiance(Vector3f::Zero(), {0.036f, 0.015f, 0.5f}, width(65)),
            posed.Radiance(Vector3f::Zero(), {0.036f, 0.015f, 0.5f}, width(63)));
}

TEST(TargetSurface, HasTheSameRadiancesForBundlesAndRays) {
  for (const std::string& text :
       {std::string("type: chessboard\ncolumns: 4\nrows: 3\nsquare: 0.03\n"), kTwoTags}) {
    const Target nominal = Read(text);
    const bool tags = text == kTwoTags;
    const TrueTarget made =
        tags ? MakeTarget(nominal, 0.001, TagErrors::kRigid, 2) : Displaced(nominal, 0.001);
    const TargetSurface surface(nominal, made, 1);
    const RigidTransform T = tags ? FrontOfTags(0.5) : Front(0.5);
    const PosedSurface posed(surface, T);
    Random random(1, "bundle");
    for (const double x : {0.02, -0.02, 0.07}) {
      RayBundle rays;
      rays.z = 0.05f;
      rays.count = 100;
      for (size_t i = 0; i < 100; ++i) {
        rays.x[i] = static_cast<float>(random.Uniform(-0.01, 0.01));
        rays.y[i] = static_cast<float>(random.Uniform(-0.01, 0.01));
        const Vector3d to =
            T * Vector3d(x + random.Uniform(-0.02, 0.02), 0.01 + random.Uniform(-0.02, 0.02), 0);
        rays.dx[i] = static_cast<float>(to.x() - rays.x[i]) / static_cast<float>(to.z() - rays.z);
        rays.dy[i] = static_cast<float>(to.y() - rays.y[i]) / static_cast<float>(to.z() - rays.z);
      }
      std::array<float, RayBundle::kMost> by_face{}, alone{};
      posed.Radiances(rays, {0.0001f, 0}, 0, &by_face);
      posed.Radiances(rays, {0.0001f, 0}, -1, &alone);
      float least = 1, most = 0;
      for (size_t i = 0; i < 100; ++i) {
        EXPECT_NEAR(by_face[i], alone[i], 0.02) << i;
        EXPECT_EQ(alone[i], posed.Radiance(rays.Origin(i), rays.Direction(i), {0.0001f, 0}));
        least = std::min(least, alone[i]), most = std::max(most, alone[i]);
      }
      EXPECT_GT(most - least, 0.5);
      rays.count = 0;
      by_face.fill(7);
      posed.Radiances(rays, {0.0001f, 0}, 0, &by_face);
      EXPECT_EQ(by_face[0], 7);
    }
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
