// SPDX-License-Identifier: Apache-2.0
#include "engine/formats/lens_form.h"

#include <gmock/gmock.h>

#include <array>
#include <string>
#include <vector>

#include "tests/engine/formats/camera_of_model.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using testing::CameraOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;
using testing::RefusalOf;
using ::testing::StartsWith;

// A tool whose pixels begin at a half, with the coefficients in an order of its own.
const LensTable& Table() {
  static const LensTable kTable{.tool = "tool",
                                .forms = {{"pinhole", "bent", "0 0"},
                                          {"pinhole-radtan4", "bent", "p_1 0 k_2 p_2 k_1"},
                                          {"fov", "wide", "omega"}},
                                .first_pixel = 0.5,
                                .keys = {"a", "b", "u", "v"},
                                .coefficient_keys = {{"bent", "q r s t w"}}};
  return kTable;
}

std::string Refused(const CalibratedCamera& camera) {
  return RefusalOf([&] { (void)ToLens(camera, Table()); }, ErrorKind::kJob);
}

TEST(WordsOf, AreBetweenBlanks) {
  EXPECT_THAT(WordsOf("k_1 0 k_2"), ElementsAre("k_1", "0", "k_2"));
  EXPECT_THAT(WordsOf("one"), ElementsAre("one"));
  EXPECT_THAT(WordsOf(""), IsEmpty());
}

TEST(LensForm, HasTheToolsOrderAndPixels) {
  const CalibratedCamera camera =
      CameraOf("pinhole-radtan4", {500, 501, 320, 240, -0.25, 0.125, 0.001, -0.002});
  const Lens lens = ToLens(camera, Table());
  EXPECT_EQ(lens.name, "bent");
  EXPECT_THAT(lens.Numbers(), ElementsAre(500, 501, 320.5, 240.5, 0.001, 0, 0.125, -0.002, -0.25));
  EXPECT_THAT(lens.Entries(Table()),
              ElementsAre(Pair("a", 500),
                          Pair("b", 501),
                          Pair("u", 320.5),
                          Pair("v", 240.5),
                          Pair("q", 0.001),
                          Pair("r", 0),
                          Pair("s", 0.125),
                          Pair("t", -0.002),
                          Pair("w", -0.25)));
  const CalibratedCamera back = FromLens(lens, {640, 480}, Table(), "file");
  EXPECT_EQ(back.model->name, "pinhole-radtan4");
  EXPECT_EQ(back.params, camera.params);
  EXPECT_EQ(back.image_size, camera.image_size);
  const Lens same = LensOfNumbers("bent", lens.Numbers());
  EXPECT_EQ(same.Numbers(), lens.Numbers());
  EXPECT_EQ(same.name, "bent");
}

TEST(LensForm, OfALensIsTheFirstWithAllThatIsNotZero) {
  const auto model_of = [](const std::string& name, const std::vector<double>& coefficients) {
    const Lens lens{name, 500, 500, 320, 240, coefficients};
    return std::string(FromLens(lens, {640, 480}, Table(), "file").model->name);
  };
  EXPECT_EQ(model_of("bent", {}), "pinhole");
  EXPECT_EQ(model_of("bent", {0, 0, 0, 0, 0, 0}), "pinhole");
  EXPECT_EQ(model_of("bent", {0, 0, 0, 0, 0.1}), "pinhole-radtan4");
  EXPECT_EQ(model_of("bent", {0.1}), "pinhole-radtan4");
  EXPECT_EQ(model_of("bent", {0.1, 0, 0, 0, 0, 0}), "pinhole-radtan4");
  EXPECT_EQ(model_of("wide", {0.9}), "fov");
  EXPECT_EQ(
      RefusalOf([&] {
        model_of("bent", {0, 0.5});
      }),
      "file: no camera model of this plenocal has all coefficients [0, 0.5] of the lens 'bent'");
  EXPECT_EQ(RefusalOf([&] { model_of("bend", {}); }),
            "file: the lens 'bend' is not read; did you mean 'bent'?");
  EXPECT_EQ(RefusalOf([&] {
              FromLens({"bent", -500, 1, 2, 3, {}}, {640, 480}, Table(), "file");
            }),
            "file: f_x = -500 is outside (0, inf)");
}

TEST(LensForm, OfACameraThatDoesNotFitHasTheNearest) {
  const std::vector<double> radtan{500, 500, 320, 240, -0.1, 0.01, 0, 0, 0};
  EXPECT_THAT(Refused(CameraOf("pinhole-radtan", radtan)),
              StartsWith("camera 'left': tool cannot hold model pinhole-radtan; of the models that "
                         "it takes pinhole-radtan4 differs least, "));
  EXPECT_THAT(Refused(CameraOf("pinhole-radtan", radtan)),
              HasSubstr(" px: plenocal convert CALIBRATION --to pinhole-radtan4"));
  LensTable plain = Table();
  plain.forms = {{"pinhole-radtan4", "bent", "k_1 k_2"}};
  const auto refused = [&](const std::vector<double>& params) {
    return RefusalOf([&] { (void)ToLens(CameraOf("pinhole-radtan4", params), plain); },
                     ErrorKind::kJob);
  };
  EXPECT_THAT(refused({500, 500, 320, 240, -0.1, 0, 0, 0.001}),
              StartsWith("camera 'left': tool has no place for p_2 of model pinhole-radtan4; no "
                         "model that it takes images all that this camera sees; 'plenocal "
                         "undistort' makes images of a pinhole camera"));
  EXPECT_EQ(refused({500, 500, 320, 240, -0.1, 0, 0, 0}), "no refusal");
  // Of no single centre.
  std::vector<double> pupil = radtan;
  pupil.insert(pupil.end(), {0.01, 0, 0});
  EXPECT_THAT(Refused(CameraOf("pinhole-radtan+pupil", pupil)),
              HasSubstr("; it has no single centre: 'plenocal convert --to MODEL --distance"));
}

class LensEntries : public testing::InTemporaryFolder {
 protected:
  [[nodiscard]] std::vector<double> Read(const std::string& text, const LensTable& table) const {
    return ReadLensEntries(YamlNode::ReadFile(Write("lens.yaml", text)), "bent", table, "my_")
        .Numbers();
  }
};

TEST_F(LensEntries, AreReadByTheirKeys) {
  LensTable table = Table();
  const std::string intrinsics = "my_a: 1\nmy_b: 2\nmy_v: 4\nmy_u: 3\n", some = "my_s: 7\n";
  EXPECT_THAT(Read(intrinsics + some + "my_q: 5\nmy_r: 6\nmy_t: 8\nmy_w: 9\n", table),
              ElementsAre(1, 2, 3, 4, 5, 6, 7, 8, 9));
  EXPECT_THAT(RefusalOf([&] { (void)Read(intrinsics + some, table); }), HasSubstr("my_q"));
  table.may_lack_coefficients = true;
  EXPECT_THAT(Read(intrinsics + some, table), ElementsAre(1, 2, 3, 4, 0, 0, 7, 0, 0));
  EXPECT_THAT(RefusalOf([&] { (void)Read("my_a: 1\nmy_b: 2\nmy_u: 3\n" + some, table); }),
              HasSubstr("my_v"));
}

TEST(RequireOneFocalLength, StatesByHowMuchTheirMeanWouldMovePoints) {
  const CalibratedCamera camera = CameraOf("pinhole", {500, 505, 320, 240});
  RequireOneFocalLength(camera, {"bent", 500, 500, 320, 240, {}}, "tool");
  EXPECT_EQ(RefusalOf(
                [&] {
                  RequireOneFocalLength(camera, {"bent", 500, 505, 320, 240, {}}, "tool");
                },
                ErrorKind::kJob),
            "camera 'left': tool has one focal length, this camera has f_x = 500 and f_y = 505; "
            "write their mean into a copy of calibration.yaml and export that: points move by up "
            "to 1.6 px");
  // Half of the difference at the border of an image that is higher than wide.
  CalibratedCamera high = camera;
  high.image_size = {480, 800};
  EXPECT_THAT(RefusalOf(
                  [&] {
                    RequireOneFocalLength(high, {"bent", 505, 500, 240, 400, {}}, "tool");
                  },
                  ErrorKind::kJob),
              HasSubstr("up to 2 px"));
}

TEST(Panorama, HasItsParametersByTheSizeOfTheImage) {
  const std::array<double, 4> params{320, 320, 999.5, 499.5};
  const CalibratedCamera camera = PanoramaCamera({2000, 1000}, params);
  EXPECT_EQ(camera.model->name, "spherical");
  EXPECT_EQ(camera.image_size, (ImageSize{2000, 1000}));
  EXPECT_THAT(camera.params, ElementsAre(320, 320, 999.5, 499.5));
  CheckPanorama(camera, params, "tool");
  CalibratedCamera other = camera;
  other.name = "top";
  other.params[2] += 1e-6;
  EXPECT_THAT(RefusalOf([&] { CheckPanorama(other, params, "tool"); }, ErrorKind::kJob),
              StartsWith("camera 'top': tool takes the parameters from the size of a spherical "
                         "image, c_x = 999.5, this one has 999.500001; calibrate with 'initial: "
                         "{f_x: 320, f_y: 320, c_x: 999.5, c_y: 499.5}'"));
  other.params[2] = params[2] - 1e-8;
  CheckPanorama(other, params, "tool");
}

}  // namespace TEST_FILE
}  // namespace plenocal
