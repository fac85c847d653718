// SPDX-License-Identifier: Apache-2.0
//
// render_tags PAIRS FOLDER: session.yaml, target.yaml and PAIRS stereo pairs of 1280 x 1024 that
// show 9 x 6 tags of tag36h11 in random poses.
#include <apriltag/apriltag.h>
#include <apriltag/tag36h11.h>
#include <fmt/core.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <thread>
#include <vector>

#include "tests/detectors/render.h"

namespace {

constexpr int kColumns = 9, kRows = 6;
constexpr double kSize = 0.03, kPitch = 0.039, kBaseline = 0.06, kFocal = 1200;
const cv::Size kImageSize(1280, 1024);

/// The board: x right, y down, the first tag's upper left corner at the origin.
plenocal::testing::GrayFunction Board() {
  apriltag_family_t* family = tag36h11_create();
  const int width = family->total_width;  // with the white margin
  std::vector<std::uint8_t> cells;
  for (int id = 0; id < kColumns * kRows; ++id) {
    image_u8_t* tag = apriltag_to_image(family, static_cast<std::uint32_t>(id));
    for (int y = 0; y < width; ++y) {
      for (int x = 0; x < width; ++x) cells.push_back(tag->buf[y * tag->stride + x]);
    }
    free(tag->buf);
    free(tag);
  }
  const double cell = kSize / family->width_at_border;
  const int margin = (width - family->width_at_border) / 2;
  tag36h11_destroy(family);
  return [=](const Eigen::Vector2d& point) {
    const int column = static_cast<int>(std::floor((point.x() + margin * cell) / kPitch));
    const int row = static_cast<int>(std::floor((point.y() + margin * cell) / kPitch));
    if (column < 0 || row < 0 || column >= kColumns || row >= kRows) return 230.0;
    const int x = static_cast<int>(std::floor((point.x() - column * kPitch) / cell)) + margin;
    const int y = static_cast<int>(std::floor((point.y() - row * kPitch) / cell)) + margin;
    if (x < 0 || y < 0 || x >= width || y >= width) return 230.0;
    return cells[((row * kColumns + column) * width + y) * width + x] > 127 ? 230.0 : 25.0;
  };
}

void WriteFiles(const std::filesystem::path& folder) {
  std::ofstream target(folder / "target.yaml");
  target << "plenocal: 1\ntype: apriltag\nfamily: tag36h11\ntolerance: 0.0005\ntags:\n";
  for (int id = 0; id < kColumns * kRows; ++id) {
    const double x = kPitch * (id % kColumns), y = kPitch * (id / kColumns);
    target << fmt::format(
        "  - {{id: {0}, corners: [[{1:.4f}, {4:.4f}, 0], [{2:.4f}, {4:.4f}, 0], [{2:.4f}, "
        "{3:.4f}, 0], [{1:.4f}, {3:.4f}, 0]]}}\n",
        id,
        x,
        x + kSize,
        y,
        y + kSize);
  }
  std::ofstream(folder / "session.yaml")
      << "plenocal: 1\ntarget: target.yaml\ncameras:\n"
         "  left: {model: pinhole-radial3, images: left/*.png}\n"
         "  right: {model: pinhole-radial3, images: right/*.png}\n";
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 3) {
    fmt::print(stderr, "usage: render_tags PAIRS FOLDER\n");
    return 2;
  }
  const std::filesystem::path folder = argv[2];
  WriteFiles(folder);
  Eigen::Matrix3d K;
  K << kFocal, 0, (kImageSize.width - 1) / 2.0, 0, kFocal, (kImageSize.height - 1) / 2.0, 0, 0, 1;
  std::mt19937 engine(1);
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<Eigen::Isometry3d> poses;  // T_rig_target; the rig is midway between the cameras
  for (int i = 0; i < std::atoi(argv[1]); ++i) {
    const Eigen::Vector3d rotation(0.5 * unit(engine), 0.5 * unit(engine), 0.2 * unit(engine));
    const Eigen::Vector3d place(
        0.03 * unit(engine), 0.03 * unit(engine), 0.58 + 0.06 * unit(engine));
    const Eigen::Vector3d centre(
        (kPitch * (kColumns - 1) + kSize) / 2, (kPitch * (kRows - 1) + kSize) / 2, 0);
    poses.push_back(Eigen::Translation3d(place) *
                    Eigen::AngleAxisd(rotation.norm(), rotation.normalized()) *
                    Eigen::Translation3d(-centre));
  }

  const auto board = Board();
  const unsigned cores = std::max(1U, std::thread::hardware_concurrency());
  std::vector<std::jthread> threads;
  for (const char* side : {"left", "right"}) std::filesystem::create_directory(folder / side);
  for (unsigned thread = 0; thread < cores; ++thread) {
    threads.emplace_back([&, thread] {
      for (size_t i = thread; i < 2 * poses.size(); i += cores) {
        const bool left = i % 2 == 0;
        Eigen::Matrix3d H;  // board to image
        H << poses[i / 2].linear().leftCols<2>(), poses[i / 2].translation();
        H(0, 2) += left ? kBaseline / 2 : -kBaseline / 2;
        const plenocal::testing::RenderOptions options{
            .blur = 0.8, .noise = 3, .seed = static_cast<unsigned>(i + 1), .supersampling = 3};
        const cv::Mat image =
            plenocal::testing::Render(plenocal::testing::View(board, K * H), kImageSize, options);
        cv::imwrite(folder / (left ? "left" : "right") / fmt::format("{:03}.png", i / 2), image);
      }
    });
  }
  return 0;
}
