// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;

class TrajectoryFile : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::string Put(const std::string& name, const std::string& text) const {
    return Write(name, text).string();
  }
  [[nodiscard]] Trajectory Read(const std::string& text) const {
    return ReadTrajectory(Put("poses.txt", text), {});
  }
  // The message without the path of the file.
  [[nodiscard]] std::string Refusal(const std::string& text, const std::string& times = {}) const {
    try {
      static_cast<void>(ReadTrajectory(Put("poses.txt", text), times));
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      std::string message = error.what();
      for (size_t at; (at = message.find(folder_.string() + "/")) != std::string::npos;) {
        message.erase(at, folder_.string().size() + 1);
      }
      return message;
    }
    return {};
  }
};

constexpr double kRounding = 1e-12;

TEST_F(TrajectoryFile, OfTumHasSecondsAndTheQuaternionsScalarLast) {
  const Trajectory found = Read(
      "\xEF\xBB\xBF# timestamp tx ty tz qx qy qz qw\n\n  12.5 1 2 3 0 0 0.6 0.8\t\r\n"
      "13 +4 5e-1 -6 0 0 0 1.005\n13 7 7 7 0 0 0 1\n");
  EXPECT_THAT(found.times, ElementsAre(12.5, 13));
  EXPECT_TRUE(found.has_times);
  EXPECT_EQ(found.repeated, 1U);
  EXPECT_EQ(found.positions[0], Eigen::Vector3d(1, 2, 3));
  EXPECT_EQ(found.positions[1], Eigen::Vector3d(4, 0.5, -6));
  EXPECT_TRUE(found.orientations[0].isApprox(Eigen::Quaterniond(0.8, 0, 0, 0.6), kRounding));
  EXPECT_NEAR(found.orientations[1].norm(), 1, kRounding);
}

TEST_F(TrajectoryFile, OfOrbSlamMayHaveNanoseconds) {
  const std::string pose = " 0 0 0 0 0 0 1\n";
  // 99 999 999 999 s are 3169 years.
  EXPECT_EQ(Read("99999999999" + pose).times[0], 99999999999.0);
  EXPECT_THAT(Read("1403636579763555584" + pose + "1403636580763555584" + pose).times,
              ElementsAre(::testing::DoubleNear(1403636579.763555584, 1e-6),
                          ::testing::DoubleNear(1403636580.763555584, 1e-6)));
}

TEST_F(TrajectoryFile, OfEurocHasNanosecondsTheScalarFirstAndMoreColumns) {
  const Trajectory found =
      Read("#timestamp, p_x, ...\ntime,x,y,z,qw,qx,qy,qz\n2000000000,1,2,3,0.8,0,0.6,0,9,9,nan\n");
  EXPECT_THAT(found.times, ElementsAre(2));
  EXPECT_EQ(found.positions[0], Eigen::Vector3d(1, 2, 3));
  EXPECT_TRUE(found.orientations[0].isApprox(Eigen::Quaterniond(0.8, 0, 0.6, 0), kRounding));
}

TEST_F(TrajectoryFile, OfATableHasTheOrderOfItsColumns) {
  for (const char* header : {"timestamp,tx,ty,tz,qx,qy,qz,qw\n",
                             "# Time [s], x [m], y [m], z [m], Q_X, Q_Y, Q_Z, Q_W []\n"}) {
    const Trajectory found = Read(header + std::string("12.5,1,2,3,0,0,0.6,0.8\n"));
    EXPECT_THAT(found.times, ElementsAre(12.5)) << header;
    EXPECT_TRUE(found.orientations[0].isApprox(Eigen::Quaterniond(0.8, 0, 0, 0.6), kRounding));
  }
  const Trajectory euroc = Read(
      "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
      "q_RS_z []\n2000000000,1,2,3,0.8,0,0.6,0\n");
  EXPECT_TRUE(euroc.orientations[0].isApprox(Eigen::Quaterniond(0.8, 0, 0.6, 0), kRounding));
  EXPECT_THAT(Refusal("12.5,1,2,3,0,0,0.6,0.8\n"),
              ::testing::HasSubstr("poses.txt:1: time 12.5 is no whole number of nanoseconds"));
  EXPECT_EQ(Refusal("frame,x,y,z,qx,qy,qz,qw\n01,1,2,3,0,0,0.6,0.8\n"),
            "poses.txt:2: the first column has frames; write the time of each pose in their place");
}

TEST_F(TrajectoryFile, OfKittiHasTheRowsOfAMatrix) {
  const std::string first = "1 0 0 4 0 1 0 5 0 0 1 6\n", second = "0 -1 0 7 1 0 0 8 0 0 1 9\n";
  const Trajectory found = Read(first + second);
  EXPECT_FALSE(found.has_times);
  EXPECT_THAT(found.times, ElementsAre(0, 1));
  EXPECT_EQ(found.positions[1], Eigen::Vector3d(7, 8, 9));
  Eigen::Matrix3d R;
  R << 0, -1, 0, 1, 0, 0, 0, 0, 1;
  EXPECT_TRUE(found.orientations[1].toRotationMatrix().isApprox(R, kRounding));
  const std::string times = Put("times.txt", "# s\n0.5\n0.75\n");
  const Trajectory timed = ReadTrajectory(Put("poses.txt", first + second), times);
  EXPECT_TRUE(timed.has_times);
  EXPECT_THAT(timed.times, ElementsAre(0.5, 0.75));
  EXPECT_EQ(Refusal(first, times), "times.txt: has 2 times, but poses.txt has 1 poses");
  EXPECT_EQ(Refusal(first + second + first, times),
            "times.txt: has 2 times, but poses.txt has 3 poses");
  EXPECT_EQ(Refusal(first, Put("times.txt", "2\n1\n")),
            "times.txt:2: time 1.000000000 comes after 2.000000000; sort the poses by time");
}

TEST_F(TrajectoryFile, IsRefusedWithItsLine) {
  EXPECT_EQ(Refusal("# none\n"), "poses.txt: holds no poses");
  EXPECT_EQ(Refusal("1 2 3\n"),
            "poses.txt:1: 3 numbers are no pose; expected 't x y z qx qy qz qw' (TUM, ORB-SLAM), "
            "'t,x,y,z,qw,qx,qy,qz' (EuRoC) or the 12 numbers of a 3 x 4 matrix (KITTI)");
  EXPECT_EQ(Refusal("1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0\n"),
            "poses.txt:2: expected 8 numbers, found 7");
  EXPECT_EQ(Refusal("1 0 0 0 0 0 0 1\n\n2 0 0 0 0 0 0 1 5\n"),
            "poses.txt:3: expected 8 numbers, found 9");
  EXPECT_EQ(Refusal("1 0 0 0 0 0 0 1\n2 0 0 0m 0 0 0 1\n"),
            "poses.txt:2: expected a number, found '0m'");
  EXPECT_EQ(Refusal("1 0 0 nan 0 0 0 1\n"),
            "poses.txt:1: number 4 is nan; a pose that is not known must be left out");
  EXPECT_EQ(Refusal("1 0 0 0 0 0 0 1.02\n"), "poses.txt:1: the quaternion has length 1.02, not 1");
  EXPECT_EQ(Refusal("1 0 0 0 0 0 0 0.98\n"), "poses.txt:1: the quaternion has length 0.98, not 1");
  EXPECT_EQ(Refusal("2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n"),
            "poses.txt:2: time 1.000000000 comes after 2.000000000; sort the poses by time");
  const std::string no_rotation = "poses.txt:1: the left 3 x 3 numbers are no rotation matrix";
  EXPECT_EQ(Refusal("1 0 0 0 0 1 0 0 0 0 1.01 0\n"), no_rotation);  // stretched
  EXPECT_EQ(Refusal("1 0.02 0 0 0 1 0 0 0 0 1 0\n"), no_rotation);  // oblique
  EXPECT_EQ(Refusal("1 0 0 0 0 1 0 0 0 0 -1 0\n"), no_rotation);    // a reflection
  EXPECT_EQ(Refusal("1 0 0 0 0 1 0 0 0 0 1.004 0\n"), "");          // few digits
}

}  // namespace TEST_FILE
}  // namespace plenocal
