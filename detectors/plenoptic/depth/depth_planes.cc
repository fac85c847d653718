// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/depth/depth_planes.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "calib/base/robust.h"

namespace plenocal::internal {
namespace {

/// Calls `use` with each pixel of a map that a part covers.
template <typename Use>
void ForEachPixel(const VirtualDepth& depth, const FlatPart& part, const Use& use) {
  std::vector<cv::Point> corners;
  for (const cv::Point2f& p : part) corners.emplace_back(cvRound(p.x), cvRound(p.y));
  const cv::Rect box = cv::boundingRect(corners) & cv::Rect({0, 0}, depth.inverse.size());
  if (box.empty()) return;
  for (cv::Point& p : corners) p -= box.tl();
  cv::Mat inside = cv::Mat::zeros(box.size(), CV_8U);
  cv::fillConvexPoly(inside, corners, cv::Scalar(255));
  for (int y = 0; y < box.height; ++y) {
    for (int x = 0; x < box.width; ++x) {
      if (inside.at<uchar>(y, x) != 0) use(cv::Point(box.x + x, box.y + y));
    }
  }
}

/// Homogeneous raw coordinates of a pixel of the map.
Eigen::Vector3d RawPoint(const VirtualDepth& depth, cv::Point at) {
  return {depth.scale * at.x, depth.scale * at.y, 1};
}

}  // namespace

std::optional<DepthPlane> FitDepthPlane(const VirtualDepth& depth, const FlatPart& part) {
  constexpr int kPasses = 5;  // of reweighting
  struct Point {
    Eigen::Vector3d q;
    double v, variance;
  };
  std::vector<Point> points;
  Eigen::Vector2d middle(0, 0);
  ForEachPixel(depth, part, [&](cv::Point at) {
    if (depth.known.at<uchar>(at) == 0) return;
    const double v = 1.0 / depth.inverse.at<float>(at);
    const double sigma = v * v * depth.sigma.at<float>(at);
    points.push_back({RawPoint(depth, at), v, sigma * sigma});
    middle += points.back().q.head<2>();
  });
  if (points.size() < 3) return std::nullopt;
  // About the middle the fit is well conditioned.
  Eigen::Matrix3d to_middle = Eigen::Matrix3d::Identity();
  to_middle.topRightCorner<2, 1>() = -middle / static_cast<double>(points.size());
  for (Point& p : points) p.q = to_middle * p.q;

  // Cauchy weights from the second pass on; the plane must hold for most pixels.
  Eigen::Vector3d plane = Eigen::Vector3d::Zero();
  Eigen::Matrix3d normal;
  for (int pass = 0; pass < kPasses; ++pass) {
    normal.setZero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (const Point& p : points) {
      const double off = p.v - plane.dot(p.q);
      const double robust =
          pass == 0 ? 1 : CauchyWeight(off * off / (kCauchyWidthSquared<> * p.variance));
      normal += robust / p.variance * p.q * p.q.transpose();
      right += robust / p.variance * p.v * p.q;
    }
    const Eigen::LDLT<Eigen::Matrix3d> solver(normal);
    if (solver.info() != Eigen::Success || !solver.isPositive()) return std::nullopt;
    plane = solver.solve(right);
    if (!plane.allFinite()) return std::nullopt;
  }
  // A raw pixel covers a square of v px in the virtual image. All estimates within such a square
  // and the window around it that it was averaged over are one measurement.
  const double together = std::pow(kDepthWindow * plane.z() / depth.scale, 2);
  return DepthPlane{to_middle.transpose() * plane,
                    to_middle.transpose() * normal.inverse() * std::max(1.0, together) * to_middle};
}

size_t FlattenParts(const std::vector<FlatPart>& parts, double common_error, VirtualDepth* depth) {
  size_t flattened = 0;
  for (const FlatPart& part : parts) {
    const auto plane = FitDepthPlane(*depth, part);
    if (!plane) continue;
    ForEachPixel(*depth, part, [&](cv::Point pixel) {
      const Eigen::Vector3d at = RawPoint(*depth, pixel);
      const double v = plane->by_q.dot(at);
      depth->inverse.at<float>(pixel) = static_cast<float>(1 / v);
      depth->sigma.at<float>(pixel) = static_cast<float>(
          std::hypot(std::sqrt(at.dot(plane->covariance * at)) / (v * v), common_error / v));
      depth->known.at<uchar>(pixel) = 255;
    });
    ++flattened;
  }
  return flattened;
}

}  // namespace plenocal::internal
