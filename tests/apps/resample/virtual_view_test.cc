// SPDX-License-Identifier: Apache-2.0
//
// plenocal undistort of raw plenoptic images: the virtual image in space, and depth in metres
// against the truth of a simulated set.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <fstream>
#include <iterator>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "engine/resample/virtual_image.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

CalibratedCamera ExampleOf(const CameraModel& model) {
  CalibratedCamera camera;
  camera.name = "camera";
  camera.model = &model;
  camera.image_size = model.example_size;
  camera.config.assign(model.example_config.begin(), model.example_config.end());
  camera.params.assign(model.example.begin(), model.example.end());
  return camera;
}

// Where the micro lens around `lens` shows a point.
std::optional<Eigen::Vector2d> Shown(const CalibratedCamera& camera,
                                     const Eigen::Vector2d& lens,
                                     const Eigen::Vector3d& p) {
  const double values[kMaxObservationSize] = {0, 0, lens.x(), lens.y()};
  Eigen::Vector2d u;
  if (!camera.model->Project(camera.params.data(), camera.config.data(), values, p, u.data())) {
    return std::nullopt;
  }
  return u;
}

TEST(VirtualImageOfModels, PointsComeBackFromWhatMicroImagesShow) {
  int models = 0;
  for (const CameraModel& model : CameraModels()) {
    if (!model.plenoptic) continue;
    ++models;
    SCOPED_TRACE(model.name);
    const CalibratedCamera camera = ExampleOf(model);
    const VirtualImage image(camera);
    const RigidTransform T_camera_view = image.ViewFromCamera().Inverse();
    for (int i = 0; i < 100; ++i) {
      const Eigen::Vector3d p(
          0.05 * std::sin(i), 0.04 * std::cos(1.7 * i), 0.5 + 0.2 * std::sin(0.3 * i));
      // The micro lens that shows the point at its own centre lies at the virtual image point.
      Eigen::Vector2d q(camera.image_size[0] / 2.0, camera.image_size[1] / 2.0);
      const Eigen::Vector3d p_camera = T_camera_view * p;
      double w = 1;
      for (int k = 0; k < 30; ++k) {
        const auto at = Shown(camera, q, p_camera);
        // As far beside as in `Point`: with aberrations w depends on that.
        const auto beside = Shown(camera, q + Eigen::Vector2d(10, 0), p_camera);
        const auto before = Shown(camera, q - Eigen::Vector2d(10, 0), p_camera);
        ASSERT_TRUE(at && beside && before);
        w = 1 - (beside->x() - before->x()) / 20;
        q += (*at - q) / w;
      }
      const auto found = image.Point(q, w);
      ASSERT_TRUE(found);
      EXPECT_LT((*found - p).norm(), 2e-4 * p.norm())
          << found->transpose() << "; " << p.transpose();
      const auto place = image.Place(p);
      ASSERT_TRUE(place);
      EXPECT_LT((*place - q).norm(), 1e-4);
      // Of a change of w the point moves along its ray, by as much as the sigma says.
      const auto certain = image.Point(q, w, 1e-4);
      const auto moved = image.Point(q, w + 1e-4);
      ASSERT_TRUE(certain && moved);
      EXPECT_NEAR(std::abs(moved->z() - found->z()), certain->sigma_z, 0.02 * certain->sigma_z);
    }
    const SeenImage seen = image.Seen(2);
    EXPECT_EQ(seen.size[0], (camera.image_size[0] + 1) / 2);
    const auto axis = seen.direction(seen.c);
    ASSERT_TRUE(axis);
    EXPECT_LT(axis->hnormalized().norm(), 1e-9);
  }
  EXPECT_EQ(models, 4);
}

TEST(VirtualImageOfModels, OfTheThinLensIsCentredInTheCamera) {
  const CameraModel* const thin = FindModel(CameraModels(), "focused-plenoptic");
  const CalibratedCamera camera = ExampleOf(*thin);
  const VirtualImage image(camera);
  EXPECT_LT(image.ViewFromCamera().t.norm(), 1e-9);
  // q is a pinhole image of focal length b_L0 + B (docs/plenoptic.md).
  const double f = (camera.params[1] + camera.params[2]) / camera.config[0];
  EXPECT_NEAR(image.Seen(1).f.x(), f, 1e-3 * f);
}

class VirtualView : public Workspace {
 protected:
  void SetUp() override {
    if (!fs::exists(set_)) GTEST_SKIP() << Absent(set_);
  }
  [[nodiscard]] cv::Mat Load(const std::string& name) const {
    return cv::imread(Path(name).string(), cv::IMREAD_UNCHANGED);
  }
  [[nodiscard]] static std::string TextOf(const fs::path& path) {
    std::ifstream file(path);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  const fs::path set_ = OptionalData("sim_small");
};

TEST_F(VirtualView, DistancesOfTagsAreTrue) {
  const std::vector<std::string> frames{"000100", "000105"};
  const Outcome outcome = Run({"undistort",
                               (set_ / "truth/calibration.yaml").string(),
                               "--camera",
                               "plenoptic",
                               (set_ / "plenoptic/000100.png").string(),
                               (set_ / "plenoptic/000105.png").string(),
                               "-o",
                               "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node camera = YAML::Load(Read("out/calibration.yaml"))["cameras"]["plenoptic"];
  const Eigen::Matrix4d T_view_rig = Matrix(camera["T_camera_rig"]);
  const auto param = [&](const char* name) { return camera["parameters"][name].as<double>(); };
  std::vector<YAML::Node> corners(63);
  for (const YAML::Node& tag : YAML::Load(TextOf(set_ / "truth/target.yaml"))["tags"]) {
    corners.at(tag["id"].as<size_t>()) = tag["corners"];
  }
  const Table poses(TextOf(set_ / "truth/poses.csv"));
  std::vector<double> relative, pulls;
  for (const std::string& frame : frames) {
    const cv::Mat depth = Load("out/" + frame + "_depth.tiff");
    const cv::Mat sigma = Load("out/" + frame + "_depth_sigma.tiff");
    ASSERT_EQ(depth.type(), CV_32F);
    const cv::Mat view = Load("out/" + frame + ".png");
    ASSERT_EQ(view.size(), depth.size());
    // Grey as the raw image, whose dark seams between the micro images are gone.
    ASSERT_EQ(view.type(), CV_8UC1);
    const cv::Mat raw =
        cv::imread((set_ / "plenoptic" / (frame + ".png")).string(), cv::IMREAD_UNCHANGED);
    EXPECT_GT(cv::mean(view)[0], cv::mean(raw)[0]);
    EXPECT_LT(cv::mean(view)[0], 2 * cv::mean(raw)[0]);
    const auto names = poses.Column("frame");
    const auto row =
        static_cast<size_t>(std::find(names.begin(), names.end(), frame) - names.begin());
    const auto number = [&](const char* column) { return poses.Numbers(column).at(row); };
    const Eigen::Quaterniond turn(number("qw"), number("qx"), number("qy"), number("qz"));
    const Eigen::Vector3d shift(number("x"), number("y"), number("z"));
    for (const YAML::Node& tag : corners) {
      Eigen::Vector3d centre = Eigen::Vector3d::Zero();
      for (const YAML::Node& corner : tag) {
        for (int i = 0; i < 3; ++i) centre[i] += corner[i].as<double>() / 4;
      }
      const Eigen::Vector3d in_rig = turn.conjugate() * (centre - shift);
      const Eigen::Vector3d p = (T_view_rig * in_rig.homogeneous()).head<3>();
      if (p.z() <= 0) continue;
      const auto x = static_cast<int>(std::lround(param("f_x") * p.x() / p.z() + param("c_x")));
      const auto y = static_cast<int>(std::lround(param("f_y") * p.y() / p.z() + param("c_y")));
      if (x < 0 || y < 0 || x >= depth.cols || y >= depth.rows) continue;
      const float z = depth.at<float>(y, x);
      if (std::isnan(z)) continue;
      relative.push_back(std::abs(z - p.z()) / p.z());
      pulls.push_back(std::abs(z - p.z()) / sigma.at<float>(y, x));
    }
  }
  ASSERT_GT(relative.size(), 60U);
  std::sort(relative.begin(), relative.end());
  std::sort(pulls.begin(), pulls.end());
  EXPECT_LT(relative[relative.size() / 2], 0.01);
  // One sigma holds 68 % of normal errors; of some sixty the share is known to 6 %.
  const double one_sigma = pulls[static_cast<size_t>(0.6827 * static_cast<double>(pulls.size()))];
  EXPECT_GT(one_sigma, 0.6);
  EXPECT_LT(one_sigma, 1.4);
  RecordProperty("figures",
                 fmt::format("{} tags, median |error| {:.2f} %, one sigma {:.2f}",
                             relative.size(),
                             100 * relative[relative.size() / 2],
                             one_sigma));
}

TEST_F(VirtualView, CloudsAreInMetresAndWhatCannotBeIsRefused) {
  const std::string raw = (set_ / "plenoptic/000100.png").string();
  const std::string calibration = (set_ / "truth/calibration.yaml").string();
  const Outcome outcome = Run({"undistort",
                               calibration,
                               "--camera",
                               "plenoptic",
                               raw,
                               "-o",
                               "out",
                               "--fov",
                               "20",
                               "--size",
                               "300x200",
                               "--cloud",
                               "cloud.ply"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(Load("out/000100.png").size(), cv::Size(300, 200));
  const std::string ply = Read("cloud.ply");
  const std::string end = "end_header\n";
  const std::size_t body = ply.find(end) + end.size();
  EXPECT_THAT(ply.substr(0, body), HasSubstr("binary_little_endian"));
  const std::size_t label = ply.find("element vertex ") + 15;
  const auto count = static_cast<std::size_t>(std::stoul(ply.substr(label)));
  constexpr std::size_t kVertex = 4 * 4 + 3;
  ASSERT_EQ(ply.size(), body + count * kVertex);
  std::vector<float> distances;
  for (std::size_t i = 0; i < count; ++i) {
    std::array<float, 4> numbers;
    std::memcpy(numbers.data(), ply.data() + body + i * kVertex, sizeof numbers);
    distances.push_back(numbers[2]);
    EXPECT_GT(numbers[3], 0);
  }
  std::sort(distances.begin(), distances.end());
  // SOURCE.md: 0.36 to 0.72 m.
  EXPECT_GT(distances[count / 10], 0.3);
  EXPECT_LT(distances[count / 2], 0.8);

  const auto refused = [&](const std::vector<std::string>& arguments, const std::string& part) {
    const Outcome bad = Run(arguments);
    EXPECT_EQ(bad.status, kWrongInput) << bad.err;
    EXPECT_EQ(Lines(bad.err).size(), 1U) << bad.err;
    EXPECT_THAT(bad.err, HasSubstr(part));
  };
  refused({"undistort",
           calibration,
           "--camera",
           "plenoptic",
           raw,
           (set_ / "plenoptic/000105.png").string(),
           "-o",
           "o",
           "--cloud",
           "c.ply"},
          "--cloud");
  refused({"undistort", calibration, "--camera", "plenoptic", raw, "--keep-vignetting", "-o", "o"},
          "--keep-vignetting: goes with ordinary cameras; 'plenoptic' is plenoptic");
  refused({"undistort",
           calibration,
           "--camera",
           "left",
           (set_ / "left/000100.png").string(),
           "-o",
           "o",
           "--cloud",
           "c.ply"},
          "plenoptic");
  refused({"undistort",
           calibration,
           "--camera",
           "plenoptic",
           (set_ / "left/000100.png").string(),
           "-o",
           "o"},
          "640 x 512");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
