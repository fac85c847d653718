// SPDX-License-Identifier: Apache-2.0
//
// `plenocal white`: files in, files, summary and messages out.
#include <fmt/format.h>

#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <string>

#include "tests/apps/workspace.h"
#include "tests/detectors/plenoptic/white/white_field.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
namespace fs = std::filesystem;

constexpr int kImages = 3;

class WhiteCommand : public Workspace {
 protected:
  WhiteCommand() { fs::create_directories(Path("white")); }

  void WriteImage(const std::string& name, const cv::Mat& image) const {
    cv::imwrite(Path(name).string(), image);
  }

  /// white/0.png ..: `image` scaled to `brightest` of 255.
  void WriteWhites(const cv::Mat& image, double brightest = 220) const {
    double highest = 0;
    cv::minMaxLoc(image, nullptr, &highest);
    cv::Mat gray;
    image.convertTo(gray, CV_8U, brightest / highest);
    for (int i = 0; i < kImages; ++i) WriteImage(fmt::format("white/{}.png", i), gray);
  }

  [[nodiscard]] Outcome White(const std::string& model = "focused-plenoptic") const {
    return Run({"white", "white", "--model", model, "-o", "out"});
  }

  /// `plenocal white` must fail with this status, one line with all of `parts`, and leave nothing.
  void ExpectRefused(int status,
                     const std::vector<std::string>& parts,
                     const std::string& model = "focused-plenoptic") const {
    const Outcome outcome = White(model);
    EXPECT_EQ(outcome.status, status) << outcome.err;
    EXPECT_EQ(Lines(outcome.err).size(), 1u) << outcome.err;
    for (const std::string& part : parts) EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_TRUE(Files("out").empty());
  }
};

const WhiteField kField{.size = {400, 300}, .pitch = 17};

cv::Mat Shading() {
  cv::Mat image(300, 400, CV_32F);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      const double r2 = ((x - 200) * (x - 200) + (y - 150) * (y - 150)) / 62500.0;
      image.at<float>(y, x) = static_cast<float>(1 / (1 + 0.4 * r2));
    }
  }
  return image;
}

cv::Mat Scene() {
  cv::Mat image(300, 400, CV_32F);
  for (int y = 0; y < image.rows; ++y) {
    for (int x = 0; x < image.cols; ++x) {
      image.at<float>(y, x) = (x / 60 + y / 50) % 2 == 0 ? 0.2f : 1.0f;
    }
  }
  return image;
}

TEST_F(WhiteCommand, WritesGridAttenuationAndPictureOfAPlenopticCamera) {
  const RenderedField truth = Render(kField);
  WriteWhites(truth.white);
  const Outcome outcome = White();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out,
              AllOf(HasSubstr("pitch 17.0"), HasSubstr("rotation 3.00"), HasSubstr("3 types")));
  const Table lenses(Read("out/micro_lenses_white.csv"));
  EXPECT_EQ(lenses.Rows(), truth.lenses.size());
  const cv::Mat attenuation =
      cv::imread(Path("out/vignetting_white.tiff").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(attenuation.type(), CV_32F);
  double lowest = 0, highest = 0;
  cv::minMaxLoc(attenuation, &lowest, &highest);
  EXPECT_GT(lowest, 0);
  EXPECT_LE(highest, 1);
  EXPECT_FALSE(cv::imread(Path("out/grid_white.png").string()).empty());
}

TEST_F(WhiteCommand, ReadsSixteenBitTiff) {
  const RenderedField truth = Render(kField);
  cv::Mat deep;
  truth.white.convertTo(deep, CV_16U);  // 12 bits in 16
  WriteImage("white/0.tif", deep);
  const Outcome outcome = White();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("of 4095 grey values"));
}

TEST_F(WhiteCommand, SmoothsTheAttenuationOfAnOrdinaryCamera) {
  WriteWhites(Shading());
  const Outcome outcome = White("pinhole-radial3");
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const cv::Mat attenuation =
      cv::imread(Path("out/vignetting_white.tiff").string(), cv::IMREAD_UNCHANGED);
  constexpr double kRounding = 0.005;  // of 8 bits, and smoothing at the borders
  EXPECT_LT(cv::norm(attenuation, Shading(), cv::NORM_L2) / std::sqrt(attenuation.total()),
            kRounding);
  EXPECT_EQ(Files("out").size(), 2u);
}

TEST_F(WhiteCommand, LeavesOutAnImageThatDiffers) {
  WriteWhites(Render(kField).white);
  WriteImage("white/lamp_off.png", cv::Mat(300, 400, CV_8U, cv::Scalar(30)));
  const Outcome outcome = White();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, AllOf(HasSubstr("left out"), HasSubstr("lamp_off.png")));
  EXPECT_THAT(outcome.out, HasSubstr("3 of 4 white images"));
}

TEST_F(WhiteCommand, SaysThatFewMicroImagesDoNotShowTheirErrors) {
  WriteWhites(Render({.size = {150, 110}, .pitch = 19}).white);
  const Outcome outcome = White();
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("fewer than 60 whole micro images"));
  WriteWhites(Render(kField).white);
  EXPECT_THAT(White().err, Not(HasSubstr("fewer than 60")));
}

TEST_F(WhiteCommand, RefusesAnArrayWhoseHalfIsDark) {
  cv::Mat white = Render(kField).white;
  white.colRange(190, 400) *= 0.01;
  WriteWhites(white);
  ExpectRefused(kJobFailed, {"are they of a plenoptic camera, in focus and lit all over?"});
}

TEST_F(WhiteCommand, WarnsOfAMosaicThatWasNotAnnounced) {
  WhiteField field = kField;
  field.bayer = true;
  WriteWhites(Render(field).white);
  const std::string warning = "look like raw colour mosaics";
  EXPECT_THAT(White().err, HasSubstr(warning));
  EXPECT_THAT(
      Run({"white", "white", "--model", "focused-plenoptic", "--bayer", "RGGB", "-o", "out"}).err,
      Not(HasSubstr(warning)));
  const Outcome shifted =
      Run({"white", "white", "--model", "focused-plenoptic", "--bayer", "GRBG", "-o", "shifted"});
  EXPECT_EQ(shifted.status, kWrongInput);
  EXPECT_THAT(shifted.err, HasSubstr("the order is RGGB or BGGR"));
  WriteWhites(Render(kField).white);
  EXPECT_THAT(White().err, Not(HasSubstr(warning)));
}

TEST_F(WhiteCommand, SaysThatThereAreNoWhiteImages) {
  ExpectRefused(kWrongInput, {"white images", "no image"});
}

TEST_F(WhiteCommand, NamesAWhiteImageOfAnotherSize) {
  WriteWhites(Render(kField).white);
  WriteImage("white/other.png", cv::Mat(200, 300, CV_8U, cv::Scalar(128)));
  ExpectRefused(kWrongInput, {"white/other.png", "300 x 200", "400 x 300"});
}

TEST_F(WhiteCommand, SaysThatPlenopticWhiteImagesShowAScene) {
  WriteWhites(Render(kField).white.mul(Scene()));
  ExpectRefused(kJobFailed, {"scene"});
}

TEST_F(WhiteCommand, SaysThatOrdinaryWhiteImagesShowAScene) {
  WriteWhites(Scene());
  ExpectRefused(kJobFailed, {"show a scene", "even white field"}, "pinhole-radial3");
}

TEST_F(WhiteCommand, NamesASaturatedImage) {
  WriteWhites(Render(kField).white, 400);
  ExpectRefused(kJobFailed, {"white/0.png", "saturated", "shorten the exposure"});
}

TEST_F(WhiteCommand, NamesABlackImage) {
  WriteWhites(Render(kField).white, 2);
  ExpectRefused(kJobFailed, {"white/0.png", "black", "expose longer"});
}

TEST_F(WhiteCommand, SaysThatACameraIsNotPlenoptic) {
  WriteWhites(Shading());
  ExpectRefused(kJobFailed, {"no hexagonal or rectangular lattice"});
}

TEST_F(WhiteCommand, SuggestsTheNearestModel) {
  WriteWhites(Shading());
  ExpectRefused(kWrongInput, {"did you mean 'focused-plenoptic'"}, "focussed-plenoptic");
}

TEST_F(WhiteCommand, OfASessionTakesNoOptionsOfImages) {
  Write("session.yaml", "plenocal: 1\n");
  for (const std::vector<std::string>& options :
       {std::vector<std::string>{"--camera", "left"}, {"--bayer", "RGGB"}}) {
    const Outcome outcome = Run({"white", "session.yaml", options[0], options[1], "-o", "out"});
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_THAT(outcome.err, HasSubstr("--camera and --bayer go with --model"));
  }
}

// Only the XML file cannot hold it.
TEST_F(WhiteCommand, KeepsTheResultsOfARectangularGridThatHasNoXml) {
  WhiteField field = kField;
  field.lattice = LatticeKind::kRectangular;
  field.types = 1;
  WriteWhites(Render(field).white);
  const Outcome outcome =
      Run({"white", "white", "--model", "focused-plenoptic", "--xml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.err, HasSubstr("white: the grid is not written as XML: RayCalibData holds"));
  EXPECT_FALSE(Read("out/micro_lenses_white.csv").empty());
  EXPECT_FALSE(fs::exists(Path("out/micro_lenses_white.xml")));
}

TEST_F(WhiteCommand, TakesTheGridOfARayCalibDataFile) {
  WhiteField field = kField;
  field.rotation_deg = 0;
  field.offset = {0.5, -1.25};
  const RenderedField truth = Render(field);
  WriteWhites(truth.white);
  Write("grid.xml",
        R"(<RayCalibData version="1.0"><offset><x>0.5</x><y>1.25</y></offset>
<diameter>17</diameter><rotation>0</rotation>
<lens_base_x><x>-1</x><y>0</y></lens_base_x><lens_base_y><x>-0.5</x><y>-0.8660254</y></lens_base_y>
<lens_type id="0"><offset><x>0</x><y>0</y></offset></lens_type>
<lens_type id="1"><offset><x>-1</x><y>0</y></offset></lens_type>
<lens_type id="2"><offset><x>1</x><y>0</y></offset></lens_type></RayCalibData>)");
  const Outcome outcome =
      Run({"white", "white", "--model", "focused-plenoptic", "--grid", "grid.xml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const Table lenses(Read("out/micro_lenses_white.csv"));
  EXPECT_THAT(outcome.err, Not(HasSubstr("distortion")));
  ASSERT_EQ(lenses.Rows(), truth.lenses.size());
  const auto x = lenses.Numbers("x"), y = lenses.Numbers("y");
  for (const TrueLens& lens : truth.lenses) {
    double nearest = 1e9;
    for (size_t i = 0; i < x.size(); ++i) {
      nearest = std::min(nearest, std::hypot(x[i] - lens.centre.x(), y[i] - lens.centre.y()));
    }
    EXPECT_LT(nearest, 1e-4);
  }
  Write("grid.xml",
        Replaced(Read("grid.xml"),
                 "<diameter>",
                 "<distortion><function>Brown</function></distortion><diameter>"));
  EXPECT_THAT(
      Run({"white", "white", "--model", "focused-plenoptic", "--grid", "grid.xml", "-o", "out"})
          .err,
      AllOf(HasSubstr("grid.xml"), HasSubstr("lens distortion (Brown) is not used")));
  Write("grid.xml", Replaced(Read("grid.xml"), "<diameter>17", "<diameter>15.2"));
  const Outcome foreign = Run(
      {"white", "white", "--model", "focused-plenoptic", "--grid", "grid.xml", "-o", "foreign"});
  EXPECT_EQ(foreign.status, kJobFailed);
  EXPECT_THAT(foreign.err, HasSubstr("the grid does not fit the white images"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
