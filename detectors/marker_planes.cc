// SPDX-License-Identifier: Apache-2.0
#include "detectors/marker_planes.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace plenocal::internal {
namespace {

struct Point {
  Eigen::Vector3d place;  // x, y relative to the part's middle, 1
  double v, variance;
};

}  // namespace

size_t FlattenParts(const std::vector<FlatPart>& parts, VirtualDepth* depth) {
  constexpr int kPasses = 5;
  size_t flattened = 0;
  for (const FlatPart& part : parts) {
    cv::Mat inside(depth->inverse.size(), CV_8U, cv::Scalar(0));
    std::vector<cv::Point> corners;
    for (const cv::Point2f& p : part) corners.emplace_back(cvRound(p.x), cvRound(p.y));
    cv::fillConvexPoly(inside, corners, cv::Scalar(255));
    const cv::Rect box = cv::boundingRect(corners) & cv::Rect({0, 0}, inside.size());
    const Eigen::Vector2d middle(box.x + box.width / 2.0, box.y + box.height / 2.0);
    const auto place = [&](int x, int y) {
      return Eigen::Vector3d(x - middle.x(), y - middle.y(), 1);
    };

    std::vector<Point> points;
    for (int y = box.y; y < box.br().y; ++y) {
      for (int x = box.x; x < box.br().x; ++x) {
        if (inside.at<uchar>(y, x) == 0 || depth->known.at<uchar>(y, x) == 0) continue;
        const double v = 1.0 / depth->inverse.at<float>(y, x);
        const double sigma = v * v * depth->sigma.at<float>(y, x);
        points.push_back({place(x, y), v, sigma * sigma});
      }
    }
    // Cauchy weights from the second pass on; the plane must hold for most pixels.
    Eigen::Vector3d plane = Eigen::Vector3d::Zero();
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    for (int pass = 0; pass < kPasses; ++pass) {
      normal.setZero();
      Eigen::Vector3d right = Eigen::Vector3d::Zero();
      for (const Point& p : points) {
        const double off = p.v - plane.dot(p.place);
        const double robust = pass == 0 ? 1 : 1 / (1 + off * off / (2.385 * 2.385 * p.variance));
        normal += robust / p.variance * p.place * p.place.transpose();
        right += robust / p.variance * p.v * p.place;
      }
      const Eigen::LDLT<Eigen::Matrix3d> solver(normal);
      if (points.size() < 3 || solver.info() != Eigen::Success || !solver.isPositive()) break;
      plane = solver.solve(right);
    }
    if (points.size() < 3 || plane.isZero()) continue;
    // Estimates within one raw pixel's square of the virtual image, v px wide, and the 5 x 5 around
    // it that it was averaged with are one measurement.
    const double together = std::pow(5 * plane.z() / depth->scale, 2);
    const Eigen::Matrix3d covariance = normal.inverse() * std::max(1.0, together);
    for (int y = box.y; y < box.br().y; ++y) {
      for (int x = box.x; x < box.br().x; ++x) {
        if (inside.at<uchar>(y, x) == 0) continue;
        const Eigen::Vector3d at = place(x, y);
        const double v = plane.dot(at);
        depth->inverse.at<float>(y, x) = static_cast<float>(1 / v);
        depth->sigma.at<float>(y, x) =
            static_cast<float>(std::sqrt(at.dot(covariance * at)) / (v * v));
        depth->known.at<uchar>(y, x) = 255;
      }
    }
    ++flattened;
  }
  return flattened;
}

}  // namespace plenocal::internal
