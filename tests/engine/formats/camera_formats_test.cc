// SPDX-License-Identifier: Apache-2.0
//
// What every camera file of another tool has in common: what is written is read back.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "engine/formats/camera_format.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;

class CameraFiles : public testing::InTemporaryFolder {
 protected:
  // The cameras of files that are written from these.
  [[nodiscard]] std::vector<CalibratedCamera> ThereAndBack(
      const CameraFormat& format, const std::vector<CalibratedCamera>& cameras) const {
    std::vector<std::string> texts;
    if (format.write_files != nullptr && cameras.size() > 1) {
      texts = format.write_files(cameras);
    } else if (format.has_file_per_camera) {
      for (const CalibratedCamera& camera : cameras) texts.push_back(format.write({camera}));
    } else {
      texts.push_back(format.write(cameras));
    }
    std::vector<CalibratedCamera> back;
    for (size_t i = 0; i < texts.size(); ++i) {
      const auto path = Write(fmt::format("{}{}", i, format.extension), texts[i]);
      const bool fisheye = cameras[i].model->name == "kannala-brandt4";
      for (CalibratedCamera& camera :
           ReadCameraFile(format, {path, cameras[i].image_size, fisheye})) {
        back.push_back(std::move(camera));
      }
    }
    return back;
  }
};

CalibratedCamera Example(const CameraFormat& format,
                         const CameraModel& model,
                         const std::string& name) {
  CalibratedCamera camera{
      .name = name,
      .model = &model,
      .image_size = model.example_size,
      .config = {model.example_config.begin(), model.example_config.end()},
      .params = {model.example.begin(), model.example.end()},
      .covariance = Eigen::MatrixXd::Zero(std::ssize(model.example), std::ssize(model.example)),
      .T_camera_rig = {}};
  if (format.name == "openmvg") camera.params[1] = camera.params[0];  // has one focal length
  return camera;
}

// Largest distance of the images of directions about the axis, px; of plenoptic cameras of their
// parameters, relative.
double Difference(const CalibratedCamera& a, const CalibratedCamera& b) {
  double largest = 0;
  if (a.model->plenoptic) {
    EXPECT_EQ(a.model, b.model);
    for (size_t i = 0; i < a.params.size(); ++i) {
      largest = std::max(largest, std::abs(a.params[i] - b.params[i]) / std::abs(a.params[i]));
    }
    return largest;
  }
  for (double x = -0.5; x <= 0.5; x += 0.125) {
    for (double y = -0.4; y <= 0.4; y += 0.1) {
      Eigen::Vector2d at_a, at_b;
      const Eigen::Vector3d p(x, y, 1);
      const auto image = [&](const CalibratedCamera& camera, Eigen::Vector2d* at) {
        return camera.model->Project(
            camera.params.data(), camera.config.data(), nullptr, p, at->data());
      };
      if (!image(a, &at_a)) continue;
      EXPECT_TRUE(image(b, &at_b)) << p.transpose();
      largest = std::max(largest, (at_a - at_b).norm());
    }
  }
  return largest;
}

// Of poses; ORB-SLAM3 has them in 32 bits.
double ToleranceOf(const CameraFormat& format) { return format.name == "orbslam3" ? 1e-6 : 1e-12; }

// What each format holds of the models' examples.
const std::map<std::string, std::vector<std::string>> kHeld{
    {"alicevision", {"pinhole", "pinhole-radial3", "pinhole-radtan", "kannala-brandt4", "fov"}},
    {"aria", {"kannala-brandt4", "equidistant"}},
    {"basalt",
     {"pinhole", "ucm", "eucm", "double-sphere", "fov", "kannala-brandt4", "pinhole-radtan8"}},
    {"cahvor", {"pinhole"}},
    {"colmap",
     {"pinhole",
      "pinhole-radial3",
      "pinhole-radtan4",
      "pinhole-radtan8",
      "equidistant",
      "kannala-brandt4",
      "fov",
      "division",
      "eucm"}},
    {"dso", {"pinhole", "pinhole-radtan4", "kannala-brandt4", "fov"}},
    {"kalibr",
     {"pinhole", "pinhole-radtan4", "kannala-brandt4", "fov", "eucm", "double-sphere", "ucm"}},
    {"lifcal", {"focused-plenoptic"}},
    {"mat", {"pinhole", "pinhole-radtan"}},
    {"matlab", {"pinhole", "pinhole-radial3", "pinhole-radtan4", "pinhole-radtan"}},
    {"metashape",
     {"pinhole",
      "pinhole-radial3",
      "pinhole-radtan",
      "equidistant",
      "kannala-brandt4",
      "equisolid"}},
    {"mrcal", {"pinhole", "pinhole-radtan4", "pinhole-radtan8", "pinhole-radtan12"}},
    {"nerfstudio", {"pinhole", "pinhole-radtan4", "kannala-brandt4"}},
    {"ocamcalib", {"scaramuzza"}},
    {"opencv", {"pinhole", "pinhole-radtan8", "pinhole-radtan12"}},
    {"openmvg", {"pinhole", "pinhole-radial3", "pinhole-radtan", "kannala-brandt4"}},
    {"orbslam2", {"pinhole", "pinhole-radtan"}},
    {"orbslam3", {"pinhole", "pinhole-radtan", "kannala-brandt4"}},
    {"ros", {"pinhole", "pinhole-radtan", "pinhole-radtan8", "kannala-brandt4"}}};

TEST_F(CameraFiles, HoldTheModels) {
  for (const CameraFormat& format : CameraFormats()) {
    for (const std::string& name : kHeld.at(std::string(format.name))) {
      SCOPED_TRACE(fmt::format("{}: {}", format.name, name));
      const CalibratedCamera camera = Example(format, *FindModel(CameraModels(), name), "camera");
      const std::vector<CalibratedCamera> back = ThereAndBack(format, {camera});
      ASSERT_EQ(back.size(), 1U);
      EXPECT_EQ(back[0].image_size, camera.image_size);
      EXPECT_LT(Difference(camera, back[0]), 1e-8);
    }
  }
}

// Three cameras where the format has place for them, turned and shifted about all axes.
TEST_F(CameraFiles, HoldTheRig) {
  for (const CameraFormat& format : CameraFormats()) {
    if (!format.holds_extrinsics) continue;
    SCOPED_TRACE(std::string(format.name));
    const CameraModel& model =
        *FindModel(CameraModels(), kHeld.at(std::string(format.name)).back());
    std::vector<CalibratedCamera> cameras;
    for (size_t c = 0; c < std::min<size_t>(3, format.most_cameras); ++c) {
      const auto k = static_cast<double>(c);
      cameras.push_back(Example(format, model, fmt::format("cam{}", c)));
      cameras[c].params[2] += k;  // another lens each
      cameras[c].T_camera_rig = {ExpRotation(k * Eigen::Vector3d(0.1, -0.3, 0.2)),
                                 k * Eigen::Vector3d(-0.11, 0.02, 0.03)};
    }
    const std::vector<CalibratedCamera> back = ThereAndBack(format, cameras);
    ASSERT_EQ(back.size(), cameras.size());
    const auto relative = [](const std::vector<CalibratedCamera>& rig, size_t c) {
      return rig[c].T_camera_rig * rig[0].T_camera_rig.Inverse();
    };
    for (size_t c = 0; c < cameras.size(); ++c) {
      EXPECT_LT(Difference(cameras[c], back[c]), 1e-8) << c;
      const RigidTransform expected = relative(cameras, c), found = relative(back, c);
      EXPECT_LT((found.R - expected.R).norm(), ToleranceOf(format)) << c;
      EXPECT_LT((found.t - expected.t).norm(), ToleranceOf(format)) << c;
    }
  }
}

TEST_F(CameraFiles, OfBasaltHaveAPoseAndASizeOfEachLens) {
  const CameraFormat& format = *FindCameraFormat("basalt", "");
  const auto example = [&](const char* name) {
    return Example(format, *FindModel(CameraModels(), "double-sphere"), name);
  };
  const auto file = nlohmann::json::parse(format.write({example("a"), example("b")}));
  const auto read = [&](const char* shortened) {
    auto changed = file;
    if (*shortened != 0) changed["value0"][shortened].erase(1);
    const auto path = Write("basalt.json", changed.dump());
    return testing::RefusalOf([&] { ReadCameraFile(format, {.path = path, .image_size = {}}); });
  };
  EXPECT_EQ(read(""), "no refusal");
  for (const char* key : {"T_imu_cam", "resolution", "intrinsics"}) {
    EXPECT_THAT(read(key), HasSubstr("expected as many 'T_imu_cam' and 'resolution'")) << key;
  }
}

TEST_F(CameraFiles, OfOpenCvStateThatTheirLensesAreFisheyes) {
  const CameraFormat& format = *FindCameraFormat("opencv", "");
  const auto example = [&](const char* model, const char* name) {
    return Example(format, *FindModel(CameraModels(), model), name);
  };
  const std::string fisheye = format.write({example("kannala-brandt4", "a")});
  EXPECT_THAT(fisheye, HasSubstr("\nfisheye_model: 1\n"));
  EXPECT_EQ(
      ReadCameraFile(format, {.path = Write("a.yml", fisheye), .image_size = {}}).at(0).model->name,
      "kannala-brandt4");
  EXPECT_THAT(format.write({example("pinhole", "a"), example("pinhole", "b")}),
              Not(HasSubstr("fisheye_model")));
  EXPECT_THAT(testing::RefusalOf(
                  [&] {
                    format.write({example("kannala-brandt4", "a"), example("pinhole", "b")});
                  },
                  ErrorKind::kJob),
              HasSubstr("one camera is a fisheye, the other not"));
}

TEST_F(CameraFiles, OfNerfstudioMayLackCoefficientsButNothingElse) {
  const CameraFormat& format = *FindCameraFormat("nerfstudio", "");
  const auto read = [&](const std::string& camera) {
    return ReadCameraFile(format, {.path = Write("transforms.json", camera), .image_size = {}})
        .at(0);
  };
  const std::string start =
      R"({"camera_model": "OPENCV_FISHEYE", "w": 640, "h": 480, "fl_x": 300, )";
  const CalibratedCamera camera =
      read(start + R"("fl_y": 301, "cx": 320, "cy": 240, "k2": 0.01, "frames": []})");
  EXPECT_EQ(camera.params, (std::vector<double>{300, 301, 319.5, 239.5, 0, 0.01, 0, 0}));
  EXPECT_THAT(testing::RefusalOf(
                  [&] { read(start + R"("fl_y": 301, "cx": 320, "k1": 0, "frames": []})"); }),
              HasSubstr("cy"));
}

}  // namespace TEST_FILE
}  // namespace plenocal
