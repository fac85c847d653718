// SPDX-License-Identifier: Apache-2.0
//
// Models that OpenCV has too project as its own functions do.
#include <gtest/gtest.h>

#include <opencv2/calib3d.hpp>
#include <random>

#include "models/registry.h"

namespace plenocal {
namespace TEST_FILE {

constexpr double kAgreement = 1e-9;  // px

// Points in front of the camera within `half_fov` of the axis, m.
std::vector<cv::Point3d> Points(double half_fov) {
  std::mt19937 random(7);
  std::uniform_real_distribution<double> angle(0, half_fov), azimuth(0, 2 * CV_PI), far(0.1, 10);
  std::vector<cv::Point3d> points;
  for (int i = 0; i < 500; ++i) {
    const double theta = angle(random), phi = azimuth(random);
    points.push_back(far(random) * cv::Point3d(std::sin(theta) * std::cos(phi),
                                               std::sin(theta) * std::sin(phi),
                                               std::cos(theta)));
  }
  return points;
}

// The largest distance between the model's and OpenCV's image points.
double Difference(std::string_view name, double half_fov, bool fisheye) {
  const CameraModel* model = FindModel(CameraModels(), name);
  EXPECT_NE(model, nullptr) << name;
  if (model == nullptr) return 1;
  const auto example = model->example;
  const cv::Mat K =
      (cv::Mat_<double>(3, 3) << example[0], 0, example[2], 0, example[1], example[3], 0, 0, 1);
  const std::vector<double> k(example.begin() + 4, example.end());
  const cv::Mat still = cv::Mat::zeros(3, 1, CV_64F);
  const std::vector<cv::Point3d> points = Points(half_fov);
  std::vector<cv::Point2d> image;
  if (fisheye) {
    cv::fisheye::projectPoints(points, image, still, still, K, k);
  } else {
    cv::projectPoints(points, still, still, K, k, image);
  }
  double largest = 0;
  for (size_t i = 0; i < points.size(); ++i) {
    double u[2];
    const Eigen::Vector3d p(points[i].x, points[i].y, points[i].z);
    EXPECT_TRUE(model->Project(example.data(), nullptr, u, p, u));
    largest = std::max(largest, std::hypot(u[0] - image[i].x, u[1] - image[i].y));
  }
  return largest;
}

TEST(OpenCv, ProjectsAsThePinholeModelsDo) {
  for (const char* name : {"pinhole",
                           "pinhole-radtan4",
                           "pinhole-radtan",
                           "pinhole-radtan8",
                           "pinhole-radtan12",
                           "pinhole-radtan12+tilt"}) {
    EXPECT_LT(Difference(name, 0.7, false), kAgreement) << name;
  }
}

TEST(OpenCv, ProjectsAsKannalaBrandt4Does) {
  EXPECT_LT(Difference("kannala-brandt4", 1.5, true), kAgreement);
}

}  // namespace TEST_FILE
}  // namespace plenocal
