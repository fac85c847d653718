// SPDX-License-Identifier: Apache-2.0
//
// Two boards of one print before a pair of cameras, named at random in each image.
#include "calib/rig/identical_boards.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "calib/camera/marker_id.h"
#include "calib/estimate/calibrate.h"
#include "tests/calib/random.h"
#include "tests/calib/synthetic.h"
#include "tests/refusal.h"

namespace plenocal {
namespace TEST_FILE {

struct Boards {
  std::vector<CameraInput> cameras;
  std::map<int, Eigen::Vector3d> markers;
  // By camera, frame and image column: the board that it really is.
  std::map<std::pair<size_t, std::string>, std::map<double, size_t>> truth;
};

enum class Right { kSeesBoth, kSeesOneInSomeFrames };

// The second board is `x` to the right of the first, `size` times as large, turned about y.
Boards MakeBoards(unsigned seed, double size, Right right, double x = 0.33) {
  testing::SyntheticOptions options;
  options.cameras = 2;
  options.frames = 12;
  const testing::SyntheticProblem problem = testing::MakeProblem(seed, options);
  testing::Random random(seed);
  const RigidTransform T_first_second{ExpRotation({0, -0.5, 0.05}), {x, 0.01, 0.02}};
  Boards boards;
  for (const auto& [number, p] : problem.input.markers) {
    boards.markers[number] = p;
    boards.markers[MarkerId{1, number}.Number()] = size * p;
  }
  boards.cameras = problem.input.cameras;
  for (size_t c = 0; c < boards.cameras.size(); ++c) {
    CameraInput& camera = boards.cameras[c];
    camera.views.clear();
    int frame = 0;
    for (const auto& [name, T_rig_first] : problem.T_rig_target) {
      ++frame;
      View view;
      view.frame = name;
      const bool exchanged = random.Uniform(0, 1) < 0.5;
      const bool one = right == Right::kSeesOneInSomeFrames && c == 1 && frame % 3 == 0;
      for (size_t board = 0; board < 2; ++board) {
        if (one && board == static_cast<size_t>(frame / 3 % 2)) continue;
        const RigidTransform T = problem.T_camera_rig[c] * T_rig_first *
                                 (board == 0 ? RigidTransform{} : T_first_second);
        for (const auto& [number, p] : problem.input.markers) {
          const Eigen::Vector3d on_board = boards.markers.at(MarkerId{board, number}.Number());
          double image[kMaxObservationSize];
          if (!camera.model->Project(
                  problem.params[c].data(), camera.config.data(), nullptr, T * on_board, image)) {
            continue;
          }
          const bool inside = image[0] > 0 && image[1] > 0 && image[0] < camera.image_size[0] &&
                              image[1] < camera.image_size[1];
          if (!inside) continue;
          Observation seen;
          const size_t named = exchanged ? 1 - board : board;
          seen.marker = MarkerId{named, number}.Number();
          for (size_t k = 0; k < 2; ++k) seen.values[k] = image[k] + random.Gaussian(0.05);
          boards.truth[{c, name}][seen.values[0]] = board;
          view.observations.push_back(seen);
        }
      }
      std::ranges::stable_sort(view.observations, {}, &Observation::marker);
      if (!view.observations.empty()) camera.views.push_back(view);
    }
  }
  return boards;
}

struct Count {
  int right = 0, wrong = 0;
};

Count Compare(const Boards& boards) {
  Count count;
  for (size_t c = 0; c < boards.cameras.size(); ++c) {
    for (const View& view : boards.cameras[c].views) {
      for (const Observation& seen : view.observations) {
        const size_t board = boards.truth.at({c, view.frame}).at(seen.values[0]);
        ++(MarkerId::FromNumber(seen.marker).target == board ? count.right : count.wrong);
      }
    }
  }
  return count;
}

const IdenticalBoards kPrints{
    .first = 0, .second = 1, .first_name = "floor", .second_name = "wall"};

int Total(const Boards& boards) {
  const Count count = Compare(boards);
  return count.right + count.wrong;
}

TEST(IdenticalBoards, BoardsOfOneSizeHaveOneMutualPoseInAllImages) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    Boards boards = MakeBoards(seed, 1, Right::kSeesBoth);
    const int total = Total(boards);
    ASSERT_GT(Compare(boards).wrong, 0);
    const std::vector<LeftOut> left_out = TellApart(kPrints, boards.markers, &boards.cameras);
    const Count count = Compare(boards);
    // The first is the left one in the image, which of the two that is in the world or not.
    EXPECT_EQ(std::min(count.right, count.wrong), 0) << seed;
    EXPECT_GT(count.right + count.wrong, 0.8 * total) << seed;
  }
}

TEST(IdenticalBoards, SizesDecideWhichIsWhich) {
  for (unsigned seed = 1; seed <= 4; ++seed) {
    // The left one is not the first.
    Boards boards = MakeBoards(seed, 0.7, Right::kSeesBoth, -0.33);
    TellApart(kPrints, boards.markers, &boards.cameras);
    const Count count = Compare(boards);
    EXPECT_EQ(count.wrong, 0) << seed;
    EXPECT_GT(count.right, 0) << seed;
  }
}

TEST(IdenticalBoards, AKnownPoseDecidesWhichIsWhich) {
  for (const bool turned : {false, true}) {
    Boards boards = MakeBoards(3, 1, Right::kSeesBoth);
    IdenticalBoards known = kPrints;
    known.T_first_second = RigidTransform{ExpRotation({0, -0.5, 0.05}), {0.33, 0.01, 0.02}};
    if (turned) known.T_first_second = known.T_first_second->Inverse();
    TellApart(known, boards.markers, &boards.cameras);
    const Count count = Compare(boards);
    EXPECT_EQ(turned ? count.right : count.wrong, 0);
    EXPECT_GT(turned ? count.wrong : count.right, 0);
  }
}

TEST(IdenticalBoards, ABoardAloneIsDecidedByTheOtherCamera) {
  Boards boards = MakeBoards(2, 1, Right::kSeesOneInSomeFrames);
  const auto views = boards.cameras[1].views.size();
  TellApart(kPrints, boards.markers, &boards.cameras);
  const Count count = Compare(boards);
  EXPECT_EQ(std::min(count.right, count.wrong), 0);
  EXPECT_GT(boards.cameras[1].views.size() + 2, views);
}

TEST(IdenticalBoards, ABoardAloneInAFrameIsLeftOut) {
  Boards boards = MakeBoards(2, 1, Right::kSeesOneInSomeFrames);
  boards.cameras.erase(boards.cameras.begin());
  const auto views = boards.cameras[0].views.size();
  const std::vector<LeftOut> left_out = TellApart(kPrints, boards.markers, &boards.cameras);
  EXPECT_EQ(boards.cameras[0].views.size() + left_out.size(), views);
  EXPECT_GE(left_out.size(), 4U);
  EXPECT_NE(left_out[0].reason.find("floor and wall"), std::string::npos);
  EXPECT_EQ(left_out[0].camera, boards.cameras[0].name);
}

TEST(IdenticalBoards, ACameraOfWhichNothingIsDecidedIsNamed) {
  Boards boards = MakeBoards(2, 1, Right::kSeesBoth);
  // The second camera sees the first board only, and in other frames than the first camera.
  for (View& view : boards.cameras[1].views) {
    std::erase_if(view.observations, [](const Observation& seen) {
      return MarkerId::FromNumber(seen.marker).target == 1;
    });
    view.frame += "b";
  }
  std::erase_if(boards.cameras[1].views,
                [](const View& view) { return view.observations.empty(); });
  EXPECT_THAT(testing::RefusalOf([&] { TellApart(kPrints, boards.markers, &boards.cameras); },
                                 ErrorKind::kJob),
              ::testing::StartsWith(boards.cameras[1].name + ": no image tells"));
}

TEST(IdenticalBoards, WithoutAnImageOfBothNothingTellsThemApart) {
  Boards boards = MakeBoards(2, 1, Right::kSeesBoth);
  for (CameraInput& camera : boards.cameras) {
    for (View& view : camera.views) {
      std::erase_if(view.observations, [](const Observation& seen) {
        return MarkerId::FromNumber(seen.marker).target == 1;
      });
    }
    std::erase_if(camera.views, [](const View& view) { return view.observations.empty(); });
  }
  EXPECT_THROW(TellApart(kPrints, boards.markers, &boards.cameras), Error);
}

}  // namespace TEST_FILE
}  // namespace plenocal
