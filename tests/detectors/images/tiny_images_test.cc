// SPDX-License-Identifier: Apache-2.0
//
// Images of a row or a few pixels: no library behind a detector may be called with what it does not
// take.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <opencv2/imgcodecs.hpp>

#include "detectors/apriltag/apriltag_library.h"
#include "detectors/boards/propose_target.h"
#include "detectors/plenoptic/white/lattice_period.h"
#include "detectors/types/marker_detectors.h"
#include "targets/tags/tag_family.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::IsEmpty;

cv::Mat Noise(cv::Size size) {
  cv::Mat image(size, CV_8UC1);
  cv::RNG(1).fill(image, cv::RNG::UNIFORM, 0, 256);
  return image;
}

template <typename Use>
void ForEachTinyImage(const Use& use) {
  for (const int narrow : {1, 2, 3, 4, 5, 6, 7, 8, 12, 17}) {
    for (const int wide : {narrow, 40, 2100}) {
      SCOPED_TRACE(::testing::Message() << narrow << " x " << wide);
      use(Noise({narrow, wide}));
      use(Noise({wide, narrow}));
    }
  }
}

TEST(TinyImages, HaveNoTags) {
  const internal::TagFamily family("tag16h5", 1);
  std::vector<std::uint64_t> codes;
  apriltag_family_t tags = family.Subset({0, 1}, &codes);
  internal::AprilTagLibrary library;
  library.Add(&tags, 0);
  const auto refuse = [](const apriltag_detection_t&) { FAIL() << "a tag in noise"; };
  for (const int decimate : {1, 2}) {
    ForEachTinyImage([&](const cv::Mat& image) {
      library.AdaptToNoise(image);
      library.Read(image, decimate, refuse);
    });
  }
  library.Read(Noise({40'000, 9}), 1, refuse);
}

TEST(TinyImages, ShowNoTarget) {
  for (const char* word : {"chessboard:3x4:25mm",
                           "aprilgrid:1x1:40mm:0.3:tagCircle21h7:border_bits=1",
                           "aprilgrid:2x2:40mm:0.3:tag16h5:border_bits=1",
                           "aprilgrid:5x4:40mm:0.3",
                           "charuco:3x3:36mm:22mm:4X4_50",
                           "circles:3x3:20mm:symmetric",
                           "circles:3x3:20mm:asymmetric"}) {
    SCOPED_TRACE(word);
    const auto detector = MakeMarkerDetector(TargetOfWord(word));
    ForEachTinyImage([&](const cv::Mat& image) {
      const MarkerDetections found = detector->Detect(image);
      EXPECT_THAT(found.markers, IsEmpty());
      EXPECT_FALSE(found.failure.empty());
    });
  }
}

TEST(TinyImages, ShowNoMicroLenses) {
  ForEachTinyImage([&](const cv::Mat& image) {
    cv::Mat flat;
    image.convertTo(flat, CV_32F, 1, -128);
    EXPECT_FALSE(internal::FindLatticePeriod(flat));
  });
}

class TinyImageFiles : public testing::InTemporaryFolder {
 protected:
  std::vector<FrameImage> Saved(const cv::Mat& image) const {
    const auto path = folder_ / "a.png";
    cv::imwrite(path.string(), image);
    return {{"a", path}};
  }
};

TEST_F(TinyImageFiles, ProposeNoTarget) {
  ForEachTinyImage([&](const cv::Mat& image) {
    EXPECT_THAT(ProposeTargets(Saved(image), {.threads = 1}).found, IsEmpty());
  });
}

}  // namespace TEST_FILE
}  // namespace plenocal
