// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/plenoptic_source.h"

#include <gmock/gmock.h>

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "calib/files/raytrix_grid.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"
#include "tests/temporary_folder.h"

namespace plenocal::internal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

class CameraOfFiles : public plenocal::testing::InTemporaryFolder {
 protected:
  CameraOfFiles() : array_(PlenopticScene{.types = 1}.Array()) {
    Write("grid.xml", RayCalibDataXml(array_));
    cv::imwrite(Path("raw.png").string(), cv::Mat(400, 400, CV_8U, cv::Scalar(9)));
    source_.grid = Path("grid.xml");
  }
  PlenopticCamera Load() {
    return LoadPlenopticCamera(source_, {"raw", Path("raw.png")}, 1, [&](const std::string& text) {
      messages_.push_back(text);
    });
  }

  MicroLensArray array_;
  PlenopticSource source_;
  std::vector<std::string> messages_;
};

TEST_F(CameraOfFiles, HasTheGridOfRayCalibDataUncheckedWithoutVignetting) {
  const PlenopticCamera camera = Load();
  ASSERT_GE(camera.array.lenses.size(), array_.lenses.size());
  EXPECT_LT((camera.array.e_column - array_.e_column).norm(), 1e-5);
  EXPECT_EQ(camera.attenuation.size(), cv::Size(400, 400));
  EXPECT_EQ(cv::countNonZero(camera.attenuation != 1), 0);
  EXPECT_THAT(messages_, ElementsAre(HasSubstr("the grid is used unchecked")));
}

TEST_F(CameraOfFiles, HasTheAttenuationOfItsFile) {
  source_.vignetting = Path("vignetting.tiff");
  source_.bayer = BayerOrder::kRggb;
  cv::imwrite(source_.vignetting.string(), cv::Mat(400, 400, CV_32F, cv::Scalar(0.75)));
  const PlenopticCamera camera = Load();
  EXPECT_EQ(cv::countNonZero(camera.attenuation != 0.75), 0);
  EXPECT_EQ(camera.bayer, BayerOrder::kRggb);
  EXPECT_THAT(messages_, IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
