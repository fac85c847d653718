// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/plenoptic_source.h"

#include <gmock/gmock.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>
#include <vector>

#include "calib/files/raytrix_grid.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "tests/detectors/plenoptic/plenoptic_scene.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal::internal {
namespace TEST_FILE {

using ::testing::AllOf;
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

TEST_F(CameraOfFiles, HasTheGridOfAFileInCapitals) {
  Write("grid.XML", RayCalibDataXml(array_));
  source_.grid = Path("grid.XML");
  EXPECT_GE(Load().array.lenses.size(), array_.lenses.size());
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

// Micro images of another pitch than the grid's would be matched as if they were the scene.
TEST_F(CameraOfFiles, OfTheAttenuationOfAnotherPitchIsRefused) {
  const auto write_attenuation = [&](double scale) {
    cv::Mat attenuation(400, 400, CV_32F, cv::Scalar(0));
    const double radius = 0.45 * scale * array_.Pitch();
    for (const MicroLens& lens : array_.lenses) {
      const Eigen::Vector2d c = scale * lens.centre;
      for (int y = 0; y < 400; ++y) {
        for (int x = 0; x < 400; ++x) {
          if (std::hypot(x - c.x(), y - c.y()) < radius) attenuation.at<float>(y, x) = 0.9f;
        }
      }
    }
    cv::imwrite(source_.vignetting.string(), attenuation);
  };
  source_.vignetting = Path("vignetting.tiff");
  write_attenuation(1);
  EXPECT_EQ(Load().array.types, 1);
  write_attenuation(1.13);
  EXPECT_THAT(plenocal::testing::RefusalOf([&] { Load(); }),
              AllOf(HasSubstr("grid.xml: the grid does not fit the attenuation in "),
                    HasSubstr("vignetting.tiff: only ")));
}

TEST_F(CameraOfFiles, OfAnAttenuationThatIsNoneIsRefused) {
  source_.vignetting = Path("vignetting.tiff");
  const auto message = [&](float value) {
    cv::Mat attenuation(400, 400, CV_32F, cv::Scalar(0.5));
    attenuation.at<float>(7, 9) = value;
    cv::imwrite(source_.vignetting.string(), attenuation);
    return plenocal::testing::RefusalOf([&] { Load(); });
  };
  EXPECT_THAT(message(255), HasSubstr("expected attenuations from 0 to 1, found 0.5 to 255"));
  EXPECT_THAT(message(-0.1f), HasSubstr("found -0.1"));
  EXPECT_THAT(message(NAN), HasSubstr("found pixels that are not finite"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::internal
