// SPDX-License-Identifier: Apache-2.0
//
// opencv_solve FOLDER: what make_problem wrote, solved by OpenCV with a rigid board. Prints the CPU
// seconds of the solve alone and its RMS, px.
#include <fmt/core.h>

#include <filesystem>
#include <map>
#include <opencv2/calib3d.hpp>
#include <string>
#include <vector>

#include "bench/speed/usage_seconds.h"
#include "calib/files/detections.h"
#include "models/registry.h"

namespace {

using Points2 = std::vector<cv::Point2f>;
using Points3 = std::vector<cv::Point3f>;

constexpr int kFlags = cv::CALIB_USE_LU | cv::CALIB_ZERO_TANGENT_DIST;
const cv::Size kImageSize(1280, 960);

cv::Point3f Marker(int number) {
  return {0.03F * static_cast<float>(number % 10), 0.03F * static_cast<float>(number / 10), 0};
}

struct Camera {
  std::map<std::string, std::map<int, cv::Point2f>> frames;
  cv::Mat K, distortion;

  double Calibrate() {
    std::vector<Points3> board;
    std::vector<Points2> image;
    for (const auto& [frame, points] : frames) {
      board.emplace_back();
      image.emplace_back();
      for (const auto& [number, point] : points) {
        board.back().push_back(Marker(number));
        image.back().push_back(point);
      }
    }
    std::vector<cv::Mat> rvecs, tvecs;
    return cv::calibrateCamera(board, image, kImageSize, K, distortion, rvecs, tvecs, kFlags);
  }
};

double CalibrateStereo(Camera* left, Camera* right) {
  left->Calibrate();
  right->Calibrate();
  std::vector<Points3> board;
  std::vector<Points2> image_left, image_right;
  for (const auto& [frame, points] : left->frames) {
    const auto other = right->frames.find(frame);
    if (other == right->frames.end()) continue;
    Points3 common;
    Points2 in_left, in_right;
    for (const auto& [number, point] : points) {
      const auto match = other->second.find(number);
      if (match == other->second.end()) continue;
      common.push_back(Marker(number));
      in_left.push_back(point);
      in_right.push_back(match->second);
    }
    if (common.size() < 6) continue;
    board.push_back(common);
    image_left.push_back(in_left);
    image_right.push_back(in_right);
  }
  cv::Mat R, T, E, F;
  return cv::stereoCalibrate(board,
                             image_left,
                             image_right,
                             left->K,
                             left->distortion,
                             right->K,
                             right->distortion,
                             kImageSize,
                             R,
                             T,
                             E,
                             F,
                             kFlags | cv::CALIB_USE_INTRINSIC_GUESS);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    fmt::print(stderr, "usage: opencv_solve FOLDER\n");
    return 2;
  }
  const plenocal::CameraModel& model =
      *plenocal::FindModel(plenocal::CameraModels(), "pinhole-radial3");
  std::vector<Camera> cameras;
  for (int c = 0;; ++c) {
    const std::filesystem::path csv = std::filesystem::path(argv[1]) / fmt::format("cam{}.csv", c);
    if (!std::filesystem::exists(csv)) break;
    Camera& camera = cameras.emplace_back();
    for (const plenocal::View& view : plenocal::ReadDetections(csv, model)) {
      for (const plenocal::Observation& observation : view.observations) {
        camera.frames[view.frame][observation.marker] = {static_cast<float>(observation.values[0]),
                                                         static_cast<float>(observation.values[1])};
      }
    }
  }
  const double start = plenocal::bench::CpuSeconds();
  const double rms =
      cameras.size() == 1 ? cameras[0].Calibrate() : CalibrateStereo(&cameras[0], &cameras[1]);
  fmt::print("{:.6f} {:.4f}\n", plenocal::bench::CpuSeconds() - start, rms);
  return 0;
}
