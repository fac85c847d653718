// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/views/view_images.h"

#include <gmock/gmock.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "calib/files/raytrix_grid.h"
#include "calib/io/yaml.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::internal {
namespace TEST_FILE {

using plenocal::testing::RefusalOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kDepth = 3.5, kPitch = 18;

class ViewImages : public plenocal::testing::InTemporaryFolder {
 protected:
  ViewImages() {
    const PlenopticScene scene{.width = 300, .height = 260, .pitch = kPitch, .types = 1};
    const MicroLensArray array = scene.Array();
    raw_ = scene.Raw(array);
    Write("grid.xml", RayCalibDataXml(array));
    Put("white.tiff", scene.Attenuation(array));
    Put("raw.png", raw_);
    request_.raw_image = Path("raw.png");
    request_.camera.grid = Path("grid.xml");
    request_.camera.vignetting = Path("white.tiff");
    request_.views = 3;
    request_.threads = 1;
    request_.message = [&](const std::string& text) { messages_.push_back(text); };
  }
  void Put(const std::string& name, const cv::Mat& image) const {
    cv::imwrite(Path(name).string(), image);
  }
  static cv::Mat Picture(const ViewsResult& result, const std::string& name) {
    const std::string& content = result.files.at(name);
    return cv::imdecode(std::vector<uchar>(content.begin(), content.end()), cv::IMREAD_UNCHANGED);
  }

  cv::Mat raw_;
  ViewsRequest request_;
  std::vector<std::string> messages_;
};

// Mean square of what changes from pixel to pixel, in the middle.
double Sharpness(const cv::Mat& image) {
  cv::Mat edges;
  cv::Laplacian(image(cv::Rect(image.cols / 4, image.rows / 4, image.cols / 2, image.rows / 2)),
                edges,
                CV_32F);
  return cv::norm(edges, cv::NORM_L2SQR) / static_cast<double>(edges.total());
}

TEST_F(ViewImages, AreOfPlacesInACircleAndOfPlanes) {
  request_.planes = {{kDepth}, {9, 0.75}};
  const ViewsResult result = MakeViews(request_);
  EXPECT_THAT(messages_, IsEmpty());
  EXPECT_EQ(result.summary, "9 views, 2 refocused images of 150 x 130 pixels");
  EXPECT_EQ(result.files.size(), 9 + 2 + 2);
  const YamlNode yaml = YamlNode::ReadFile(Write("views.yaml", result.files.at("views.yaml")));
  EXPECT_EQ(yaml.At("scale").AsNumber(), 2);
  const std::vector<YamlNode> views = yaml.At("views").Elements();
  const cv::Mat sheet = Picture(result, "views.png");
  ASSERT_EQ(sheet.size(), cv::Size(450, 390));
  ASSERT_EQ(views.size(), 9);
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      const YamlNode& view = views[static_cast<size_t>(3 * row + column)];
      const std::string name = view.At("file").AsString();
      EXPECT_EQ(name, "view_" + std::to_string(row) + "_" + std::to_string(column) + ".png");
      const std::vector<double> offset = view.At("offset").AsNumbers(2);
      const bool is_middle = row == 1 && column == 1;
      EXPECT_NEAR(std::hypot(offset[0], offset[1]), is_middle ? 0 : 0.3 * kPitch, 1e-4);
      EXPECT_NEAR(offset[0] * (row - 1), offset[1] * (column - 1), 1e-4) << "the same direction";
      EXPECT_GE(offset[0] * (column - 1), 0);
      const cv::Mat tile = sheet(cv::Rect(150 * column, 130 * row, 150, 130));
      EXPECT_EQ(cv::norm(tile, Picture(result, name), cv::NORM_INF), 0);
    }
  }
  const std::vector<YamlNode> planes = yaml.At("refocused").Elements();
  ASSERT_EQ(planes.size(), 2);
  EXPECT_EQ(planes[0].At("file").AsString(), "refocused_0.png");
  EXPECT_EQ(planes[0].At("virtual_depth").AsNumber(), kDepth);
  EXPECT_FALSE(planes[0].Has("distance"));
  EXPECT_EQ(planes[1].At("virtual_depth").AsNumber(), 9);
  EXPECT_EQ(planes[1].At("distance").AsNumber(), 0.75);
  const cv::Mat sharp = Picture(result, "refocused_0.png");
  EXPECT_GT(Sharpness(sharp), 2 * Sharpness(Picture(result, "refocused_1.png")));
  // The brightest thousandth is white, in all images alike.
  double brightest = 0;
  cv::minMaxLoc(sharp, nullptr, &brightest);
  EXPECT_GT(brightest, 200);
  const cv::Mat middle(sharp, cv::Rect(50, 40, 50, 50));
  const cv::Mat view = Picture(result, "view_1_1.png");
  EXPECT_NEAR(cv::mean(view(cv::Rect(50, 40, 50, 50)))[0], cv::mean(middle)[0], 12);
}

TEST_F(ViewImages, OneViewIsOfTheMiddle) {
  request_.views = 1;
  request_.planes = {{kDepth}};
  const ViewsResult result = MakeViews(request_);
  EXPECT_THAT(result.files.at("views.yaml"), HasSubstr("{file: view_0_0.png, offset: [0, 0]}"));
}

TEST_F(ViewImages, PlanesAreThoseOfTheImageWhereItHasDepths) {
  const YamlNode yaml =
      YamlNode::ReadFile(Write("views.yaml", MakeViews(request_).files.at("views.yaml")));
  std::vector<double> depths;
  for (const YamlNode& plane : yaml.At("refocused").Elements()) {
    depths.push_back(plane.At("virtual_depth").AsNumber());
  }
  ASSERT_EQ(depths.size(), 3);
  EXPECT_NEAR(depths[1], kDepth, 0.03);
  // Over the image it goes from 3.36 to 3.64.
  EXPECT_NEAR(depths[0], kDepth - 0.08, 0.04);
  EXPECT_NEAR(depths[2], kDepth + 0.08, 0.04);
}

TEST_F(ViewImages, PlanesAreAroundTheMicroLensesWithoutDepths) {
  cv::Mat flat;
  cv::imread(Path("white.tiff").string(), cv::IMREAD_UNCHANGED).convertTo(flat, CV_16U, 30000);
  Put("raw.png", flat);
  const ViewsResult result = MakeViews(request_);
  ASSERT_EQ(messages_.size(), 1);
  EXPECT_THAT(messages_[0], HasSubstr("no virtual depth ("));
  EXPECT_THAT(messages_[0], EndsWith("as for an unfocused camera"));
  const YamlNode yaml = YamlNode::ReadFile(Write("views.yaml", result.files.at("views.yaml")));
  std::vector<double> depths;
  for (const YamlNode& plane : yaml.At("refocused").Elements()) {
    depths.push_back(plane.At("virtual_depth").AsNumber());
  }
  EXPECT_THAT(depths, ::testing::ElementsAre(-0.8, -0.4, 0, 0.4, 0.8));
}

TEST_F(ViewImages, AreRefusedOfImagesThatDoNotBelongToTheMicroLenses) {
  request_.planes = {{kDepth}};
  Put("raw.png", raw_(cv::Rect(0, 0, 200, 260)));
  EXPECT_THAT(RefusalOf([&] { (void)MakeViews(request_); }), HasSubstr("200 x 260"));
  cv::Mat shifted = cv::Mat::zeros(raw_.size(), raw_.type());
  raw_(cv::Rect(9, 0, 291, 260)).copyTo(shifted(cv::Rect(0, 0, 291, 260)));
  Put("raw.png", shifted);
  EXPECT_THAT(RefusalOf([&] { (void)MakeViews(request_); }, ErrorKind::kJob),
              HasSubstr("raw.png: "));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
