// SPDX-License-Identifier: Apache-2.0
//
// Suggested views as JSON and as a picture.
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include "apps/suggest/suggestions_json.h"
#include "apps/suggest/view_sheet.h"
#include "assess/views/view_information.h"
#include "calib/estimate/describe.h"
#include "tests/calib/synthetic.h"

namespace plenocal::testing {
namespace TEST_FILE {

/// Two views for a pair of cameras that a board has been shown to a few times.
const SuggestedViews& Suggested() {
  static const SuggestedViews suggested = [] {
    SuggestedViews made;
    const CalibrationRecord record =
        Describe(Calibrate(MakeProblem(2, {.cameras = 2, .frames = 5, .noise = 0.1}).input, {}));
    made.rig = MakeRigEstimate(record);
    for (const auto& [number, marker] : record.markers) {
      made.shape.markers[number] = marker.position;
      made.shape.normals[number] = -Eigen::Vector3d::UnitZ();
    }
    made.shape.outlines = {{{0, 0, 0}, {0.27, 0, 0}, {0.27, 0.18, 0}, {0, 0.18, 0}}};
    SetFactors(record, made.shape, &made.rig);
    made.views = ChooseNextViews(made.rig, made.shape, {.count = 2});
    return made;
  }();
  return suggested;
}

TEST(SuggestedViews, AreJson) {
  const SuggestedViews& suggested = Suggested();
  const nlohmann::json json = SuggestionsJson(suggested);
  ASSERT_EQ(json["views"].size(), 2U);
  EXPECT_EQ(json["frames"], 5);
  EXPECT_EQ(json["sigma_now"], suggested.views.sigma);
  EXPECT_TRUE(json["verdict"].is_null());
  ASSERT_TRUE(suggested.views.bound);
  EXPECT_EQ(json["bound"]["words"], ViewBoundText(suggested.views));
  EXPECT_EQ(json["bound"]["sigma"], suggested.views.bound->sigma);
  for (size_t i = 0; i < 2; ++i) {
    const NextView& view = suggested.views.views[i];
    const nlohmann::json& row = json["views"][i];
    const BundleCamera& camera = suggested.rig.bundle.cameras[view.pose.camera];
    EXPECT_EQ(row["words"], NextViewText(view, suggested.rig, suggested.views.lowered));
    EXPECT_EQ(row["camera"], camera.name);
    EXPECT_NEAR(row["tilt"].get<double>(), view.pose.tilt * 180 / std::numbers::pi, 1e-9);
    EXPECT_EQ(row["distance"], view.pose.distance);
    EXPECT_EQ(row["cameras"].size(), view.cameras.size());
    EXPECT_EQ(row["criterion"], "sigma");
    EXPECT_LT(row["sigma_after"], row["sigma_before"]);
    for (const char* name : {"T_camera_target", "T_rig_target"}) {
      const RigidTransform T = name == std::string("T_rig_target")
                                   ? view.T_rig_target
                                   : camera.T_camera_rig * view.T_rig_target;
      for (int r = 0; r < 4; ++r) {
        for (int c = 0; c < 4; ++c) {
          const double expected = r == 3 ? (c == 3 ? 1 : 0) : c == 3 ? T.t[r] : T.R(r, c);
          EXPECT_EQ(row[name].at(r).at(c), expected) << name;
        }
      }
    }
    for (const auto& [c, outlines] : view.outlines) {
      const nlohmann::json& drawn = row["outline"][suggested.rig.bundle.cameras[c].name];
      ASSERT_EQ(drawn.size(), outlines.size());
      ASSERT_EQ(drawn[0].size(), outlines[0].size());
      for (size_t k = 0; k < outlines[0].size(); ++k) {
        EXPECT_NEAR(drawn[0][k][0].get<double>(), outlines[0][k].x(), 0.0051);
        EXPECT_NEAR(drawn[0][k][1].get<double>(), outlines[0][k].y(), 0.0051);
      }
    }
  }
}

TEST(SuggestedViews, HaveNoSigmaBeforeAllIsDetermined) {
  SuggestedViews suggested = Suggested();
  suggested.views.views[1].criterion = ViewCriterion::kEntropy;
  suggested.views.bound.reset();
  const nlohmann::json json = SuggestionsJson(suggested);
  EXPECT_EQ(json["views"][1]["criterion"], "undetermined");
  EXPECT_TRUE(json["bound"].is_null());
  for (const char* key :
       {"sigma_before", "sigma_after", "region_sigma_before", "region_sigma_after"}) {
    EXPECT_FALSE(json["views"][0][key].is_null());
    EXPECT_TRUE(json["views"][1][key].is_null());
  }
}

cv::Mat Decoded(const std::string& png) {
  return cv::imdecode(
      cv::Mat(1, static_cast<int>(png.size()), CV_8U, const_cast<char*>(png.data())),
      cv::IMREAD_COLOR);
}

bool IsColour(const cv::Mat& picture, const Eigen::Vector2d& at, const cv::Vec3d& rgb) {
  const auto bgr = picture.at<cv::Vec3b>(static_cast<int>(at.y()), static_cast<int>(at.x()));
  return cv::norm(cv::Vec3d(bgr[2], bgr[1], bgr[0]) - 255 * rgb) < 25;
}

const cv::Vec3d kImage(0.90, 0.91, 0.93), kMark(0.12, 0.38, 0.66);

TEST(SuggestedViews, AreDrawnWhereTheCamerasShouldShowThem) {
  const SuggestedViews& suggested = Suggested();
  const RigEstimate& rig = suggested.rig;
  const cv::Mat picture =
      Decoded(DrawViewSheet(suggested.views, rig, suggested.shape, PictureFormat::kPng));
  // Areas of the images: rows of two, in the order of the suggestions.
  cv::Mat mask, labels, stats, centres;
  cv::inRange(picture,
              cv::Scalar(255 * kImage[2] - 2, 255 * kImage[1] - 2, 255 * kImage[0] - 2),
              cv::Scalar(255 * kImage[2] + 2, 255 * kImage[1] + 2, 255 * kImage[0] + 2),
              mask);
  cv::morphologyEx(mask, mask, cv::MORPH_CLOSE, cv::Mat::ones(15, 15, CV_8U));
  std::vector<cv::Rect> images;
  const int count = cv::connectedComponentsWithStats(mask, labels, stats, centres);
  for (int i = 1; i < count; ++i) {
    const cv::Rect box(stats.at<int>(i, cv::CC_STAT_LEFT),
                       stats.at<int>(i, cv::CC_STAT_TOP),
                       stats.at<int>(i, cv::CC_STAT_WIDTH),
                       stats.at<int>(i, cv::CC_STAT_HEIGHT));
    if (box.width > 500) images.push_back(box);
  }
  ASSERT_EQ(images.size(), 4U);
  std::ranges::sort(
      images, {}, [](const cv::Rect& box) { return std::pair((box.y + 50) / 100, box.x); });
  const RigUnknowns unknowns = MakeRigUnknowns(rig.bundle, 1);
  const ViewPredictor predictor(rig, unknowns, suggested.shape);
  for (size_t i = 0; i < 4; ++i) {
    const size_t c = i % 2;
    const double scale = images[i].width / 1280.0;
    EXPECT_NEAR(scale, images[i].height / 960.0, 0.005);
    const auto at = [&](const Eigen::Vector2d& u) -> Eigen::Vector2d {
      return Eigen::Vector2d(images[i].x, images[i].y) + scale * (u + Eigen::Vector2d(0.5, 0.5));
    };
    const std::vector<Eigen::Vector2d> markers =
        predictor.PredictVisibility(c, suggested.views.views[i / 2].T_rig_target, 400).u_px;
    ASSERT_GT(markers.size(), 35U);
    for (const Eigen::Vector2d& u : markers) {
      EXPECT_TRUE(IsColour(picture, at(u), kMark)) << u.transpose();
    }
    std::vector<cv::Point2f> outline;
    for (const Eigen::Vector2d& u : suggested.views.views[i / 2].outlines.at(c).at(0)) {
      outline.emplace_back(static_cast<float>(u.x()), static_cast<float>(u.y()));
    }
    int beside = 0, drawn = 0;  // of the points so far those that the target does not cover
    for (const BundleObservation& seen : rig.bundle.observations) {
      if (seen.camera != static_cast<int>(c) || !seen.used) continue;
      const Eigen::Vector2d u(seen.seen.values[0], seen.seen.values[1]);
      const cv::Point2f place(static_cast<float>(u.x()), static_cast<float>(u.y()));
      if (cv::pointPolygonTest(outline, place, true) > -5) continue;
      ++beside;
      drawn += IsColour(picture, at(u), kImage) ? 0 : 1;
    }
    EXPECT_GT(beside, 20);
    EXPECT_GE(drawn, 0.95 * beside);
    // The camera's name in the upper left corner: two pixels a point.
    cv::Mat dark;
    cv::inRange(picture(cv::Rect(images[i].x + 8, images[i].y + 6, 60, 26)),
                cv::Scalar(0, 0, 0),
                cv::Scalar(110, 110, 110),
                dark);
    EXPECT_GT(cv::countNonZero(dark), 30);
    // In the middle of four markers the target is white; only points so far are seen through it.
    int white = 0;
    for (size_t k = 0; k + 11 < markers.size(); ++k) {
      const Eigen::Vector2d middle = (markers[k] + markers[k + 11]) / 2;
      white += IsColour(picture, at(middle), {1, 1, 1}) ? 1 : 0;
    }
    EXPECT_GT(white, 20);
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
