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

TEST_F(CameraFiles, OfNerfstudioMayBeOfAnyPerspectiveModel) {
  const CameraFormat& format = *FindCameraFormat("nerfstudio", "");
  const auto read = [&](const std::string& head, const std::string& coefficients) {
    const std::string text = "{" + head + R"("w": 640.0, "h": 480, "fl_x": 300, "fl_y": 301, )" +
                             R"("cx": 320, "cy": 240)" + coefficients + "}";
    return ReadCameraFile(format, {.path = Write("transforms.json", text), .image_size = {}}).at(0);
  };
  for (const std::string head : {R"("camera_model": "PINHOLE", )",
                                  R"("camera_model": "SIMPLE_RADIAL", )",
                                  R"("camera_model": "OPENCV", )",
                                  R"("is_fisheye": false, )",
                                  ""}) {
    EXPECT_EQ(read(head, R"(, "k1": -0.2, "p2": 0.01)").model->name, "pinhole-radtan4") << head;
    EXPECT_EQ(read(head, R"(, "k1": 0)").model->name, "pinhole") << head;
  }
  EXPECT_EQ(read(R"("is_fisheye": true, )", R"(, "k1": 0.1)").model->name, "kannala-brandt4");
  EXPECT_THAT(testing::RefusalOf([&] { read(R"("camera_model": "PINHOL", )", ""); }),
              HasSubstr("'PINHOL' is not read"));
}

// Of cv::omnidir: X / (|X| + xi Z) with radtan, then K.
TEST_F(CameraFiles, OfOpenCvsOmnidirAreOfTheUnifiedModel) {
  const CameraFormat& format = *FindCameraFormat("opencv", "");
  const double xi = 1.2, k_1 = -0.2, k_2 = 0.05, p_1 = 1e-3, p_2 = -2e-3;
  const std::string text =
      "image_width: 1280\nimage_height: 800\ncamera_matrix: [800, 0, 640, 0, 801, 400, 0, 0, 1]\n"
      "distortion_coefficients: [-0.2, 0.05, 1e-3, -2e-3]\n";
  for (const char* given : {"xi: 1.2\n", "xi: {rows: 1, cols: 1, data: [1.2]}\n"}) {
    const CalibratedCamera camera =
        ReadCameraFile(format, {.path = Write("omni.yml", text + given), .image_size = {}}).at(0);
    const Eigen::Vector3d X(0.9, -0.5, 0.7);
    const Eigen::Vector2d m = X.head<2>() / (X.z() + xi * X.norm());
    const double r2 = m.squaredNorm(), radial = 1 + k_1 * r2 + k_2 * r2 * r2;
    const Eigen::Vector2d bent(
        m.x() * radial + 2 * p_1 * m.x() * m.y() + p_2 * (r2 + 2 * m.x() * m.x()),
        m.y() * radial + p_1 * (r2 + 2 * m.y() * m.y()) + 2 * p_2 * m.x() * m.y());
    Eigen::Vector2d image;
    ASSERT_TRUE(camera.model->Project(
        camera.params.data(), camera.config.data(), image.data(), X, image.data()));
    EXPECT_LT((image - Eigen::Vector2d(800 * bent.x() + 640, 801 * bent.y() + 400)).norm(), 1e-9);
  }
  EXPECT_THAT(testing::RefusalOf([&] {
                ReadCameraFile(format,
                               {.path = Write("omni.yml", text + "xi: -1\n"), .image_size = {}});
              }),
              HasSubstr("omni.yml:5"));
}

// As ORB-SLAM2's EuRoC.yaml has them.
TEST_F(CameraFiles, OfOpenCvMayLackBlanksBehindKeys) {
  const CameraFormat& format = *FindCameraFormat("opencv", "");
  const std::string text =
      "%YAML:1.0\nimage_width:640\nimage_height: 480\ncamera_matrix: !!opencv-matrix\n   rows: 3\n"
      "   cols: 3\n   dt: d\n   data:[500, 0, 320, 0, 501, 240, 0, 0, 1]\n\"a:b\": \"c:d\" # e:f\n";
  EXPECT_EQ(ReadCameraFile(format, {.path = Write("a.yml", text), .image_size = {}}).at(0).params,
            (std::vector<double>{500, 501, 320, 240}));
  EXPECT_THAT(testing::RefusalOf([&] {
                ReadCameraFile(
                    format,
                    {.path = Write("a.xml", "<?xml version=\"1.0\"?>\n"), .image_size = {}});
              }),
              HasSubstr("write it as YAML"));
}

// Kalibr sorts the keys by their letters.
TEST_F(CameraFiles, OfKalibrChainCamerasByTheirNumbers) {
  const CameraFormat& format = *FindCameraFormat("kalibr", "");
  const std::string lens =
      "  camera_model: pinhole\n  intrinsics: [500, 500, 320, 240]\n  resolution: [640, 480]\n";
  const auto linked = [&](int number) {
    return fmt::format(
        "cam{}:\n  T_cn_cnm1: [[1, 0, 0, -{}], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n{}",
        number,
        number,
        lens);
  };
  std::string text = "cam0:\n" + lens + linked(1) + linked(10);
  for (int number = 2; number < 10; ++number) text += linked(number);
  const std::vector<CalibratedCamera> cameras =
      ReadCameraFile(format, {.path = Write("chain.yaml", text), .image_size = {}});
  ASSERT_EQ(cameras.size(), 11U);
  for (int i = 0; i < 11; ++i) {
    EXPECT_EQ(cameras[static_cast<size_t>(i)].name, fmt::format("cam{}", i));
    EXPECT_NEAR(cameras[static_cast<size_t>(i)].T_camera_rig.t.x(), -i * (i + 1) / 2.0, 1e-12);
  }
}

TEST_F(CameraFiles, WithAnotherNumberOfCoefficientsAreRefused) {
  const auto refused = [&](const char* name, const std::string& text) {
    return testing::RefusalOf([&] {
      ReadCameraFile(*FindCameraFormat(name, ""),
                     {.path = Write("camera", text), .image_size = {}});
    });
  };
  EXPECT_THAT(refused("colmap", "1 OPENCV 640 480 500 500 320 240 0.1\n"),
              HasSubstr("camera:1: OPENCV has 8 parameters, not 5"));
  EXPECT_EQ(refused("colmap", "1 SIMPLE_RADIAL 640 480 500 320 240 0.1\n"), "no refusal");
  const std::string mrcal =
      "{'lensmodel': 'LENSMODEL_OPENCV8', 'extrinsics': [0, 0, 0, 0, 0, 0], 'imagersize': [640, 480],"
      " 'intrinsics': [500, 500, 320, 240, ";
  EXPECT_THAT(refused("mrcal", mrcal + "0, 0, 0, 0]}"), HasSubstr("has 8 coefficients, not 4"));
  EXPECT_EQ(refused("mrcal", mrcal + "0, 0, 0, 0, 0, 0, 0, 0]}"), "no refusal");
  const auto kalibr = [&](const char* camera, const char* lens, int own, int coefficients) {
    std::vector<double> intrinsics(static_cast<size_t>(own), 0.1);
    for (const double value : {500., 500., 320., 240.}) intrinsics.push_back(value);
    return refused("kalibr",
                   fmt::format("cam0:\n  camera_model: {}\n  distortion_model: {}\n  intrinsics: "
                               "[{}]\n  distortion_coeffs: [{}]\n  resolution: [640, 480]\n",
                               camera,
                               lens,
                               fmt::join(intrinsics, ", "),
                               fmt::join(std::vector<double>(coefficients, 0.01), ", ")));
  };
  EXPECT_EQ(kalibr("pinhole", "radtan", 0, 4), "no refusal");
  EXPECT_EQ(kalibr("omni", "radtan", 1, 4), "no refusal");
  EXPECT_EQ(kalibr("ds", "none", 2, 0), "no refusal");
  EXPECT_THAT(kalibr("pinhole", "radtan", 1, 3), HasSubstr("expected 4 numbers"));
  EXPECT_THAT(kalibr("omni", "radtan", 0, 5), HasSubstr("expected 5 numbers"));
  EXPECT_THAT(kalibr("pinhole", "equidistant", 0, 2), HasSubstr("has 4 coefficients, not 2"));
  EXPECT_THAT(kalibr("omni", "equidistant", 1, 4), HasSubstr("'omni equidistant' is not read"));
  EXPECT_THAT(kalibr("pinhol", "radtan", 0, 4), HasSubstr("expected pinhole, omni, eucm or ds"));
}

// R and P of a pair whose second camera is 0.1 m below the first.
TEST_F(CameraFiles, OfRosHoldABaselineInEitherDirection) {
  const CameraFormat& format = *FindCameraFormat("ros", "");
  const auto read = [&](const char* P) {
    const std::string text =
        "image_width: 640\nimage_height: 480\ncamera_matrix: {data: [500, 0, 320, 0, 500, 240, 0, 0, "
        "1]}\ndistortion_model: plumb_bob\ndistortion_coefficients: {data: [0, 0, 0, 0, 0]}\n"
        "rectification_matrix: {data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
        "projection_matrix: {data: [";
    return ReadCameraFile(format, {.path = Write("a.yaml", text + P + "]}\n"), .image_size = {}})
        .at(0)
        .T_camera_rig.t;
  };
  EXPECT_LT(
      (read("500, 0, 320, 0, 0, 400, 240, -40, 0, 0, 1, 0") - Eigen::Vector3d(0, -0.1, 0)).norm(),
      1e-12);
  EXPECT_LT(
      (read("500, 0, 320, -50, 0, 400, 240, 0, 0, 0, 1, 0") - Eigen::Vector3d(-0.1, 0, 0)).norm(),
      1e-12);
}

TEST_F(CameraFiles, OfOrbSlam2HaveTheLeftCameraFirstAndMayBeFisheyes) {
  const CameraFormat& format = *FindCameraFormat("orbslam2", "");
  CalibratedCamera left = Example(format, *FindModel(CameraModels(), "pinhole"), "left"),
                   right = left;
  right.name = "right";
  right.T_camera_rig.t = {-0.1, 0, 0};
  EXPECT_THAT(format.write({left, right}), HasSubstr("Camera.bf: "));
  EXPECT_THAT(testing::RefusalOf(
                  [&] {
                    format.write({right, left});
                  },
                  ErrorKind::kJob),
              HasSubstr("give --camera left right"));
  const std::string text =
      "%YAML:1.0\nCamera.type: \"KannalaBrandt8\"\nCamera.fx: 190\nCamera.fy: 191\nCamera.cx: 250\n"
      "Camera.cy: 251\nCamera.k1: 0.01\nCamera.k2: 0\nCamera.k3: 0\nCamera.k4: 0.02\n"
      "Camera.width: 512\nCamera.height: 512\n";
  EXPECT_EQ(
      ReadCameraFile(format, {.path = Write("a.yaml", text), .image_size = {}}).at(0).model->name,
      "kannala-brandt4");
}

}  // namespace TEST_FILE
}  // namespace plenocal
