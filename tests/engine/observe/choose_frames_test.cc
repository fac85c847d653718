// SPDX-License-Identifier: Apache-2.0
//
// When frames are chosen, and the choice among drawn boards: motion and blur by their true values.
#include "engine/observe/choose_frames.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <map>
#include <opencv2/imgproc.hpp>
#include <sstream>

#include "calib/base/error.h"
#include "calib/camera/rigid_transform.h"
#include "calib/files/image_store.h"
#include "engine/session/memory_session.h"
#include "models/registry.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

constexpr const char* kBoard = "chessboard:6x4:30mm";

struct NoImages : ImageStore {
  [[nodiscard]] StoredImage Read(std::size_t) const override {
    throw Error(ErrorKind::kInput, "no image");
  }
  [[nodiscard]] StoredImage Start(std::size_t index, std::size_t) const override {
    return Read(index);
  }
  [[nodiscard]] std::string Hash(std::size_t) const override { return {}; }
};

// Frames `first` to `last` of a recording; `without_time`: one that has none.
CameraImages Recorded(int first, int last, int without_time = -1) {
  const auto store = std::make_shared<const NoImages>();
  CameraImages camera;
  for (int k = first; k <= last; ++k) {
    camera.images.push_back({.frame = std::to_string(k), .path = "p", .store = store});
    if (k != without_time) camera.images.back().time = k;
  }
  return camera;
}

// "201 frames: at most 100 ...", with which the choice begins; "" where all are kept.
std::string Begins(const Session& session, std::vector<CameraImages> cameras) {
  std::string begun;
  plenocal::Run run;
  run.listener.message = [&](const std::string& line) {
    begun = line.substr(0, line.find(" of them"));
    throw Stopped();
  };
  try {
    const FrameChoice choice = ChooseFrames(session, Target{}, nullptr, run, &cameras);
    EXPECT_THAT(choice.table, IsEmpty());
    EXPECT_THAT(choice.left_out, IsEmpty());
  } catch (const Stopped&) {
    return begun;
  }
  return begun;
}

TEST(ChooseFrames, BeginsWithLongRecordingsOrMoreFramesThanAreWanted) {
  Session session;
  session.cameras.resize(2);
  for (SessionCamera& camera : session.cameras) camera.model = FindModel(CameraModels(), "pinhole");
  const std::string usual = "201 frames: at most 100";
  EXPECT_EQ(Begins(session, {Recorded(1, 200), Recorded(1, 150)}), "");
  EXPECT_EQ(Begins(session, {Recorded(1, 200), Recorded(101, 201)}), usual);
  EXPECT_EQ(Begins(session, {Recorded(1, 201), {}}), usual);
  EXPECT_EQ(Begins(session, {Recorded(1, 201, 7), {}}), "");
  EXPECT_EQ(Begins(session, {Recorded(1, 201), Recorded(1, 9, 9)}), "");
  EXPECT_EQ(Begins(session, {{}, {}}), "");
  std::vector<CameraImages> files{Recorded(1, 201), {}};
  files[0].images[3].store = nullptr;
  EXPECT_EQ(Begins(session, files), "");
  session.frames = 200;
  EXPECT_EQ(Begins(session, files), "201 frames: at most 200");
  session.frames = 201;
  EXPECT_EQ(Begins(session, {Recorded(1, 201), {}}), "");
  session.frames.reset();
  session.all_frames = true;
  EXPECT_EQ(Begins(session, {Recorded(1, 201), {}}), "");
  session.all_frames = false;
  session.scene.emplace();
  EXPECT_EQ(Begins(session, {Recorded(1, 201), {}}), "");
  session.scene.reset();
  session.cameras[1].model = FindModel(CameraModels(), "focused-plenoptic");
  EXPECT_EQ(Begins(session, {Recorded(1, 201), {}}), "");
}

constexpr double kFocal = 280;

cv::Matx33d Homography(const RigidTransform& T) {
  const Eigen::Matrix3d K{{kFocal, 0, 159.5}, {0, kFocal, 119.5}, {0, 0, 1}};
  Eigen::Matrix3d plane;
  plane << T.R.col(0), T.R.col(1), T.t;
  const Eigen::Matrix3d H = K * plane;
  cv::Matx33d made;
  for (int i = 0; i < 9; ++i) made(i / 3, i % 3) = H(i / 3, i % 3);
  return made;
}

RigidTransform PoseOf(int view) {
  const double k = view;
  return {ExpRotation({0.35 * std::sin(2.1 * k), 0.35 * std::cos(1.7 * k), 0.1 * k}),
          {-0.075 + 0.01 * std::sin(k), -0.045, 0.34 + 0.015 * k}};
}

cv::Mat Draw(int view, double blur) {
  constexpr int kPixels = 40;  // of a square
  cv::Mat board(6 * kPixels, 8 * kPixels, CV_8U, cv::Scalar(230));
  for (int row = 0; row < 5; ++row) {
    for (int column = 0; column < 7; ++column) {
      if ((row + column) % 2 == 1) continue;
      const int x = kPixels / 2 + column * kPixels, y = kPixels / 2 + row * kPixels;
      cv::rectangle(board, {x, y, kPixels, kPixels}, cv::Scalar(25), cv::FILLED);
    }
  }
  // The first inner corner, one and a half squares from the border, is the target's origin.
  constexpr double kMetres = 0.03 / kPixels;
  const cv::Matx33d metres(
      kMetres, 0, -(60 - 0.5) * kMetres, 0, kMetres, -(60 - 0.5) * kMetres, 0, 0, 1);
  cv::Mat image;
  cv::warpPerspective(board,
                      image,
                      Homography(PoseOf(view)) * metres,
                      {320, 240},
                      cv::INTER_AREA,
                      cv::BORDER_CONSTANT,
                      cv::Scalar(230));
  cv::GaussianBlur(image, image, {}, blur);
  return image;
}

// Upper median of the distances of the corners in two views, px.
double Moved(int a, int b) {
  std::vector<double> distances;
  for (int k = 0; k < 24; ++k) {
    const cv::Vec3d p(0.03 * (k % 6), 0.03 * (k / 6), 1);
    const cv::Vec3d u = Homography(PoseOf(a)) * p, v = Homography(PoseOf(b)) * p;
    distances.push_back(std::hypot(u[0] / u[2] - v[0] / v[2], u[1] / u[2] - v[1] / v[2]));
  }
  std::ranges::nth_element(distances, distances.begin() + 12);
  return distances[12];
}

TEST(ChooseFrames, TakeTheFrameOfEachFewThatMovesLeastAndIsSharpest) {
  // Each view twice, sharp and blurred; then an image without the target and one that is excluded.
  std::vector<cv::Mat> drawn;
  for (int k = 0; k < 10; ++k) drawn.push_back(Draw(k / 2, k % 2 == 0 ? 0.5 : 1.2));
  drawn.emplace_back(240, 320, CV_8U, cv::Scalar(200));
  drawn.push_back(drawn[0]);
  MemoryImages images;
  for (size_t k = 0; k < drawn.size(); ++k) {
    images.emplace_back(fmt::format("{:02}", k),
                        PixelView{.data = drawn[k].data, .size = {320, 240}, .stride = 320});
  }
  Session session = SessionInMemory(
      kBoard, {{.name = "left", .model = FindModel(CameraModels(), "pinhole"), .images = images}});
  session.frames = 1;
  session.exclude = {{.frame = "11"}};
  std::vector<CameraImages> cameras(1);
  cameras[0].images = session.cameras[0].given_images;
  std::vector<std::string> messages;
  plenocal::Run run;
  run.threads = 1;
  run.listener.message = [&](const std::string& line) { messages.push_back(line); };
  const FrameChoice choice = ChooseFrames(session, TargetOfWord(kBoard), nullptr, run, &cameras);
  EXPECT_EQ(messages.front(),
            "12 frames: at most 1 of them are chosen (--all keeps all, --frames another number)");
  EXPECT_EQ(messages.back(),
            "1 of 11 frames are chosen (reasons for the others: chosen_frames.csv)");

  struct Row {
    double motion = 0, blur = 0;
    std::string reason;
    bool chosen = false;
  };
  std::vector<Row> rows;
  std::istringstream table(choice.table);
  std::string line;
  std::getline(table, line);
  EXPECT_EQ(line, "frame,chosen,motion,blur,points,reason");
  while (std::getline(table, line)) {
    std::vector<std::string> cells(6);
    std::istringstream text(line);
    for (size_t cell = 0; cell < 5; ++cell) std::getline(text, cells[cell], ',');
    std::getline(text, cells[5]);
    std::erase(cells[5], '"');
    const size_t k = rows.size();
    EXPECT_EQ(cells[0], fmt::format("{:02}", k));
    if (k == 10) {
      EXPECT_EQ(line.substr(0, 8), "10,0,,,0");
      rows.push_back({.reason = cells[5]});
      continue;
    }
    EXPECT_EQ(cells[4], "24");
    rows.push_back({std::stod(cells[2]), std::stod(cells[3]), cells[5], cells[1] == "1"});
    // The same view once before or after, another one on the other side.
    const int view = static_cast<int>(k) / 2, other = view + (k % 2 == 0 ? -1 : 1);
    EXPECT_NEAR(rows.back().motion, other < 0 || other > 4 ? 0 : Moved(view, other), 0.7) << k;
  }
  ASSERT_EQ(rows.size(), 11U);
  EXPECT_NE(rows[10].reason, "");

  // One of each two, by motion and blur over their medians (upper ones).
  std::vector<double> motions, blurs;
  for (size_t k = 0; k < 10; ++k) {
    motions.push_back(rows[k].motion);
    blurs.push_back(rows[k].blur);
  }
  std::ranges::sort(motions);
  std::ranges::sort(blurs);
  const auto unrest = [&](size_t k) {
    return rows[k].motion / motions[5] + rows[k].blur / blurs[5];
  };
  int chosen = 0;
  for (size_t k = 0; k < 10; k += 2) {
    const size_t best = unrest(k) <= unrest(k + 1) ? k : k + 1;
    const Row &kept = rows[best], &other = rows[k + 1 - (best - k)];
    EXPECT_EQ(other.reason,
              fmt::format("moves more or is less sharp than frame {:02} beside it", best));
    EXPECT_FALSE(other.chosen);
    EXPECT_EQ(kept.chosen, kept.reason.empty());
    if (!kept.chosen) {
      EXPECT_THAT(kept.reason,
                  AllOf(StartsWith("adds little: the frames chosen are expected to give a standard "
                                   "error of the projection of "),
                        HasSubstr(" px, all 5 candidates 0.")));
    }
    chosen += kept.chosen ? 1 : 0;
  }
  EXPECT_EQ(chosen, 1);

  // What is excluded stays, to be named as such.
  ASSERT_THAT(cameras[0].images, SizeIs(2));
  EXPECT_EQ(cameras[0].images[1].frame, "11");
  ASSERT_THAT(choice.left_out, SizeIs(10));
  for (const LeftOut& each : choice.left_out) {
    EXPECT_EQ(each.camera, "left");
    EXPECT_TRUE(each.whole);
    EXPECT_EQ(each.reason, rows[std::stoul(each.frame)].reason);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
