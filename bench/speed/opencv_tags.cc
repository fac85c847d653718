// SPDX-License-Identifier: Apache-2.0
//
// opencv_tags FOLDER: what render_tags wrote, from images to the calibration by OpenCV: ArUco with
// corners by cornerSubPix, both cameras each for itself, then together. Prints the number of
// corners and the RMS, px.
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <opencv2/aruco.hpp>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

namespace {

using Points2 = std::vector<cv::Point2f>;
using Points3 = std::vector<cv::Point3f>;
namespace fs = std::filesystem;

constexpr int kFlags = cv::CALIB_USE_LU | cv::CALIB_ZERO_TANGENT_DIST;
const cv::Size kImageSize(1280, 1024);

/// Corner `corner` of a tag, clockwise from the upper left one of the upright tag.
cv::Point3f Marker(int id, int corner) {
  constexpr int kColumns = 9;
  constexpr float kSize = 0.03F, kPitch = 0.039F;
  const float x = corner == 1 || corner == 2 ? kSize : 0, y = corner >= 2 ? kSize : 0;
  return {kPitch * static_cast<float>(id % kColumns) + x,
          kPitch * static_cast<float>(id / kColumns) + y,
          0};
}

/// Corners by 4 * id + corner.
using Corners = std::map<int, cv::Point2f>;

Corners Detect(const fs::path& file) {
  const cv::Mat image = cv::imread(file, cv::IMREAD_GRAYSCALE);
  const auto parameters = cv::makePtr<cv::aruco::DetectorParameters>();
  parameters->cornerRefinementMethod = cv::aruco::CORNER_REFINE_SUBPIX;
  std::vector<Points2> tags;
  std::vector<int> ids;
  cv::aruco::detectMarkers(image,
                           cv::makePtr<cv::aruco::Dictionary>(
                               cv::aruco::getPredefinedDictionary(cv::aruco::DICT_APRILTAG_36h11)),
                           tags,
                           ids,
                           parameters);
  Corners corners;
  for (size_t i = 0; i < ids.size(); ++i) {
    // OpenCV has the tags of this family upside down.
    for (int k = 0; k < 4; ++k) corners[4 * ids[i] + (k + 2) % 4] = tags[i][static_cast<size_t>(k)];
  }
  return corners;
}

/// Points that all of `images` show, one set for each of them and the board's.
struct Common {
  Points3 board;
  std::vector<Points2> images;
};

Common CommonOf(const std::vector<const Corners*>& images) {
  Common common{{}, std::vector<Points2>(images.size())};
  for (const auto& [number, point] : *images[0]) {
    if (!std::ranges::all_of(images, [&, n = number](const Corners* c) { return c->contains(n); }))
      continue;
    common.board.push_back(Marker(number / 4, number % 4));
    for (size_t i = 0; i < images.size(); ++i) common.images[i].push_back(images[i]->at(number));
  }
  return common;
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: opencv_tags FOLDER\n");
    return 2;
  }
  cv::setNumThreads(1);  // in one image; threads of its own take more CPU time
  std::vector<std::vector<Corners>> cameras;
  size_t count = 0;
  for (const char* side : {"left", "right"}) {
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(fs::path(argv[1]) / side)) {
      files.push_back(entry.path());
    }
    std::ranges::sort(files);
    std::vector<Corners>& camera = cameras.emplace_back();
    for (const fs::path& file : files) count += camera.emplace_back(Detect(file)).size();
  }
  std::vector<Points3> board;
  std::vector<Points2> left, right;
  cv::Mat K[2], distortion[2];
  for (size_t c = 0; c < 2; ++c) {
    std::vector<Points3> own_board;
    std::vector<Points2> own;
    for (const Corners& corners : cameras[c]) {
      Common all = CommonOf({&corners});
      own_board.push_back(std::move(all.board));
      own.push_back(std::move(all.images[0]));
    }
    std::vector<cv::Mat> rvecs, tvecs;
    cv::calibrateCamera(own_board, own, kImageSize, K[c], distortion[c], rvecs, tvecs, kFlags);
  }
  for (size_t f = 0; f < cameras[0].size(); ++f) {
    Common common = CommonOf({&cameras[0][f], &cameras[1][f]});
    board.push_back(std::move(common.board));
    left.push_back(std::move(common.images[0]));
    right.push_back(std::move(common.images[1]));
  }
  cv::Mat R, T, E, F;
  const double rms = cv::stereoCalibrate(board,
                                         left,
                                         right,
                                         K[0],
                                         distortion[0],
                                         K[1],
                                         distortion[1],
                                         kImageSize,
                                         R,
                                         T,
                                         E,
                                         F,
                                         kFlags | cv::CALIB_USE_INTRINSIC_GUESS);
  fmt::print("{} {:.4f}\n", count, rms);
  return 0;
}
