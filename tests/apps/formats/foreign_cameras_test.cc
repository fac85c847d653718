// SPDX-License-Identifier: Apache-2.0
//
// Camera files of other programs against those programs' equations, typed here a second time from
// the sources that the readers name: a point of the image that is half a pixel off fails.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <cmath>
#include <cstdlib>
#include <functional>
#include <map>
#include <numbers>

#include "engine/formats/camera_format.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

using Equation = std::function<Eigen::Vector2d(const Eigen::Vector3d&)>;
constexpr double kSame = 1e-9;  // px: rounding of some ten operations on 1e3 px

class ForeignCameras : public Workspace {
 protected:
  [[nodiscard]] std::vector<CalibratedCamera> ReadCameras(
      const std::string& format,
      const std::string& text,
      const std::string& name = "file",
      std::optional<ImageSize> size = std::nullopt) const {
    Write(name, text);
    return ReadCameraFile(*FindCameraFormat(format, Path(name)), {Path(name), size});
  }

  [[nodiscard]] CalibratedCamera ReadOne(const std::string& format, const std::string& text) const {
    return ReadCameras(format, text).at(0);
  }

  /// Written and read again the cameras have all digits.
  void ExpectBack(const std::string& format, const std::vector<CalibratedCamera>& cameras) const {
    const std::string text = FindCameraFormat(format, "file")->write(cameras);
    const std::vector<CalibratedCamera> back = ReadCameras(format, text);
    ASSERT_EQ(back.size(), cameras.size());
    for (size_t c = 0; c < cameras.size(); ++c) {
      EXPECT_EQ(back[c].model->name, cameras[c].model->name);
      EXPECT_EQ(back[c].image_size, cameras[c].image_size);
      ASSERT_EQ(back[c].params.size(), cameras[c].params.size());
      for (size_t k = 0; k < back[c].params.size(); ++k) {
        EXPECT_DOUBLE_EQ(back[c].params[k], cameras[c].params[k])
            << cameras[c].model->params[k].name;
      }
      EXPECT_LT((back[c].T_camera_rig.R - cameras[c].T_camera_rig.R).norm(), kRotation);
      EXPECT_LT((back[c].T_camera_rig.t - cameras[c].T_camera_rig.t).norm(), kRotation);
    }
  }
  static constexpr double kRotation = 1e-14;  // rounding of a product of rotations

  void ExpectRefused(const std::string& format,
                     const std::string& text,
                     const std::vector<std::string>& parts) const {
    try {
      static_cast<void>(ReadOne(format, text));
      ADD_FAILURE() << "was read: " << text;
    } catch (const Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("file"));
      for (const std::string& part : parts) EXPECT_THAT(error.what(), HasSubstr(part));
    }
  }

  void ExpectNotWritten(const std::string& format,
                        const CalibratedCamera& camera,
                        const std::vector<std::string>& parts) const {
    try {
      FindCameraFormat(format, "file")->write({camera});
      ADD_FAILURE() << "was written";
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kJob);
      for (const std::string& part : parts) EXPECT_THAT(error.what(), HasSubstr(part));
    }
  }
};

/// 200 points out to `degrees` from the axis.
void ExpectProjects(const CalibratedCamera& camera, double degrees, const Equation& equation) {
  for (int i = 0; i < 200; ++i) {
    const double theta = degrees * std::numbers::pi / 180 * std::sqrt((i + 0.5) / 200);
    const double phi = 2.4 * i;
    const Eigen::Vector3d p = (0.5 + i % 7) * Eigen::Vector3d(std::sin(theta) * std::cos(phi),
                                                              std::sin(theta) * std::sin(phi),
                                                              std::cos(theta));
    double u[2];
    ASSERT_TRUE(camera.model->Project(camera.params.data(), nullptr, nullptr, p, u)) << i;
    const Eigen::Vector2d expected = equation(camera.T_camera_rig.Inverse() * p);
    ASSERT_NEAR(u[0], expected.x(), kSame) << i;
    ASSERT_NEAR(u[1], expected.y(), kSame) << i;
  }
}

/// Of the plane at distance 1, OpenCV's order of the tangential coefficients.
Eigen::Vector2d Radtan(const Eigen::Vector3d& p,
                       const std::vector<double>& k,
                       double p_1,
                       double p_2) {
  const double x = p.x() / p.z(), y = p.y() / p.z(), q = x * x + y * y;
  double g = 1, power = 1;
  for (const double k_i : k) g += k_i * (power *= q);
  return {x * g + 2 * p_1 * x * y + p_2 * (q + 2 * x * x),
          y * g + p_1 * (q + 2 * y * y) + 2 * p_2 * x * y};
}

/// The plane point at the radius `of(theta)`.
Eigen::Vector2d Fisheye(const Eigen::Vector3d& p, const std::function<double(double)>& of) {
  const double r = std::hypot(p.x(), p.y());
  return p.head<2>() / r * of(std::atan2(r, p.z()));
}

// --- openMVG: Camera_Pinhole_Radial.hpp, Camera_Pinhole_Brown.hpp, Camera_Pinhole_Fisheye.hpp,
// Camera_Spherical.hpp; the numbers of radial_k3 are of a file of openMVG 1.
std::string SfmData(const std::string& type, const std::string& data) {
  return R"({"sfm_data_version": "0.3", "root_path": "", "views": [], "intrinsics": [{"key": 3,
"value": {"polymorphic_id": 2147483649, "polymorphic_name": ")" +
         type + R"(", "ptr_wrapper": {"id": 2147483650, "data": {)" + data +
         R"(}}}}], "extrinsics": [], "structure": [], "control_points": []})";
}
constexpr const char* kSfmSize =
    R"("width": 1600, "height": 1200, "focal_length": 925.8363, "principal_point": [750.238, 670.848])";

TEST_F(ForeignCameras, OpenMvgsLensesProjectAsThere) {
  const auto in_pixels = [](const Eigen::Vector2d& m) {
    return Eigen::Vector2d(925.8363 * m.x() + 750.238, 925.8363 * m.y() + 670.848);
  };
  const auto read = [&](const std::string& type, const std::string& distortion) {
    const CalibratedCamera camera = ReadOne("openmvg", SfmData(type, kSfmSize + distortion));
    EXPECT_EQ(camera.image_size, (ImageSize{1600, 1200}));
    EXPECT_EQ(camera.name, "camera3");
    ExpectBack("openmvg", {camera});
    return camera;
  };
  ExpectProjects(read("pinhole", ""), 40, [&](const Eigen::Vector3d& p) {
    return in_pixels(p.head<2>() / p.z());
  });
  ExpectProjects(read("pinhole_radial_k1", R"(, "disto_k1": [0.0287])"),
                 40,
                 [&](const Eigen::Vector3d& p) { return in_pixels(Radtan(p, {0.0287}, 0, 0)); });
  ExpectProjects(read("pinhole_radial_k3", R"(, "disto_k3": [0.0287, 0.0857, -0.02])"),
                 40,
                 [&](const Eigen::Vector3d& p) {
                   return in_pixels(Radtan(p, {0.0287, 0.0857, -0.02}, 0, 0));
                 });
  ExpectProjects(read("pinhole_brown_t2", R"(, "disto_t2": [-0.05, 0.01, 0.003, 0.002, -0.001])"),
                 40,
                 [&](const Eigen::Vector3d& p) {
                   return in_pixels(Radtan(p, {-0.05, 0.01, 0.003}, 0.002, -0.001));
                 });
  ExpectProjects(read("fisheye", R"(, "fisheye": [-0.02, 0.01, -0.003, 0.0004])"),
                 80,
                 [&](const Eigen::Vector3d& p) {
                   return in_pixels(Fisheye(p, [](double t) {
                     return t - 0.02 * std::pow(t, 3) + 0.01 * std::pow(t, 5) -
                            0.003 * std::pow(t, 7) + 0.0004 * std::pow(t, 9);
                   }));
                 });
  const CalibratedCamera panorama =
      ReadOne("openmvg", SfmData("spherical", R"("value0": {"width": 2000, "height": 1000})"));
  ExpectProjects(panorama, 170, [](const Eigen::Vector3d& p) {
    const double latitude = std::atan2(-p.y(), std::hypot(p.x(), p.z()));
    return Eigen::Vector2d(std::atan2(p.x(), p.z()) / (2 * std::numbers::pi) * 2000 + 1000,
                           -latitude / (2 * std::numbers::pi) * 2000 + 500);
  });
  ExpectBack("openmvg", {panorama});
}

TEST_F(ForeignCameras, ARigIsInOpenMvgsFileWithOneViewACamera) {
  std::vector<CalibratedCamera> rig{
      ReadOne("openmvg", SfmData("pinhole", kSfmSize)),
      ReadOne("openmvg",
              SfmData("pinhole_radial_k3", std::string(kSfmSize) + R"(, "disto_k3": [0.1, 0, 0])")),
      ReadOne("openmvg", SfmData("pinhole", kSfmSize))};
  rig[0].name = "left";
  rig[1].name = "right";
  rig[2].name = "top";
  rig[1].T_camera_rig = {ExpRotation({0.1, -0.2, 0.3}), {-0.1, 0.02, 0.03}};
  ExpectBack("openmvg", rig);
  const YAML::Node file = YAML::Load(FindCameraFormat("openmvg", "file")->write(rig));
  EXPECT_EQ(file["views"][1]["value"]["ptr_wrapper"]["data"]["filename"].as<std::string>(),
            "right.png");
  // Where cereal met the type before it gives the number only.
  EXPECT_EQ(file["intrinsics"][0]["value"]["polymorphic_id"].as<unsigned>(), 0x80000001U);
  EXPECT_EQ(file["intrinsics"][2]["value"]["polymorphic_id"].as<unsigned>(), 1U);
  EXPECT_FALSE(file["intrinsics"][2]["value"]["polymorphic_name"]);
  // The rotation maps into the camera, the centre is the camera's.
  const YAML::Node pose = file["extrinsics"][1]["value"];
  const Eigen::Vector3d centre(pose["center"][0].as<double>(),
                               pose["center"][1].as<double>(),
                               pose["center"][2].as<double>());
  EXPECT_LT((rig[1].T_camera_rig * centre).norm(), kRotation);
  EXPECT_DOUBLE_EQ(pose["rotation"][0][2].as<double>(), rig[1].T_camera_rig.R(0, 2));
}

TEST_F(ForeignCameras, WhatOpenMvgCannotHoldIsRefused) {
  ExpectRefused("openmvg", SfmData("pinhole_pba", kSfmSize), {"pinhole_pba"});
  ExpectRefused("openmvg", SfmData("pinhole_radial_k3", kSfmSize), {"disto_k3"});
  ExpectRefused(
      "openmvg", Replaced(SfmData("pinhole", kSfmSize), "750.238,", ""), {"principal_point"});
  ExpectRefused("openmvg",
                Replaced(SfmData("pinhole", kSfmSize), "polymorphic_name", "name"),
                {"polymorphic_name"});
  CalibratedCamera camera = ReadOne("openmvg", SfmData("pinhole", kSfmSize));
  camera.params[1] += 0.5;
  ExpectNotWritten("openmvg", camera, {"one focal length", "926.3363", "0.22 px"});
  camera = ReadOne("openmvg", SfmData("spherical", R"("value0": {"width": 200, "height": 100})"));
  camera.params[3] -= 0.5;
  ExpectNotWritten("openmvg", camera, {"c_y = 50", "49.5", "fixed: ["});
}

// --- AliceVision: DistortionRadial.cpp, DistortionBrown.cpp, DistortionFisheye{,1}.cpp,
// Equidistant.cpp, jsonIO.cpp.
std::string Sfm(const std::string& type,
                const std::string& more,
                const std::string& version = "10") {
  return R"({"version": ["1", "2", ")" + version + R"("], "views": [], "intrinsics": [
{"intrinsicId": "3486608314", "focalLength": "21.5", "pixelRatio": "1.01", "type": )" +
         type +
         R"(, "width": "3424", "height": "2202", "sensorWidth": "28.25", "sensorHeight": "18.5",
"principalPoint": ["3.25", "-8.5"], "undistortionParams": "", "distortionParams": [)" +
         more + "}]}";
}

TEST_F(ForeignCameras, AliceVisionsLensesProjectAsThere) {
  const double f_x = 21.5 / 28.25 * 3424, f_y = f_x * 1.01;
  const auto in_pixels = [&](const Eigen::Vector2d& m) {
    return Eigen::Vector2d(f_x * m.x() + 1712 + 3.25, f_y * m.y() + 1101 - 8.5);
  };
  const auto read = [&](const std::string& distortion, const std::string& params) {
    const CalibratedCamera camera =
        ReadOne("alicevision",
                Sfm(R"("pinhole", "distortionType": ")" + distortion + R"(")", params + "]"));
    EXPECT_EQ(camera.image_size, (ImageSize{3424, 2202}));
    ExpectBack("alicevision", {camera});
    return camera;
  };
  ExpectProjects(read("none", ""), 40, [&](const Eigen::Vector3d& p) {
    return in_pixels(p.head<2>() / p.z());
  });
  ExpectProjects(read("radialk1", R"("-0.05")"), 40, [&](const Eigen::Vector3d& p) {
    return in_pixels(Radtan(p, {-0.05}, 0, 0));
  });
  ExpectProjects(
      read("radialk3", R"("-0.05", "0.02", "0.001")"), 40, [&](const Eigen::Vector3d& p) {
        return in_pixels(Radtan(p, {-0.05, 0.02, 0.001}, 0, 0));
      });
  ExpectProjects(
      read("radialk3pt", R"("-0.05", "0.02", "0.001")"), 40, [&](const Eigen::Vector3d& p) {
        return in_pixels(Radtan(p, {-0.05, 0.02, 0.001}, 0, 0) / (1 - 0.05 + 0.02 + 0.001));
      });
  ExpectProjects(read("brown", R"("-0.05", "0.02", "0.001", "0.002", "-0.001")"),
                 40,
                 [&](const Eigen::Vector3d& p) {
                   return in_pixels(Radtan(p, {-0.05, 0.02, 0.001}, 0.002, -0.001));
                 });
  ExpectProjects(
      read("fisheye", R"("-0.02", "0.01", "-0.003", "0.0004")"), 80, [&](const Eigen::Vector3d& p) {
        return in_pixels(Fisheye(p, [](double t) {
          return t - 0.02 * std::pow(t, 3) + 0.01 * std::pow(t, 5) - 0.003 * std::pow(t, 7) +
                 0.0004 * std::pow(t, 9);
        }));
      });
  ExpectProjects(read("fisheye1", R"("0.9")"), 80, [&](const Eigen::Vector3d& p) {
    return in_pixels(
        Fisheye(p, [](double t) { return std::atan(2 * std::tan(t) * std::tan(0.9 / 2)) / 0.9; }));
  });
  // The shorter side of the sensor is that of a circle of 1000 px.
  const CalibratedCamera fisheye =
      ReadOne("alicevision", Sfm(R"("equidistant")", R"(], "fisheyeCircleRadius": "1000")"));
  ExpectProjects(fisheye, 100, [&](const Eigen::Vector3d& p) {
    const double fov = 18.5 / (f_x * 28.25 / 3424);
    const Eigen::Vector2d m = Fisheye(p, [&](double t) { return t / (0.5 * fov); });
    return Eigen::Vector2d(1000 * m.x() + 1712 + 3.25, 1000 * m.y() + 1101 - 8.5);
  });
  ExpectBack("alicevision", {fisheye});
  // As version 1.2.4 wrote it: the inverse of the ratio, the distortion in the type.
  const CalibratedCamera older =
      ReadOne("alicevision", Sfm(R"("radial3")", R"("-0.05", "0.02", "0.001"])", "4"));
  EXPECT_DOUBLE_EQ(older.params[1], f_x / 1.01);
  EXPECT_EQ(older.model->name, "pinhole-radial3");
}

TEST_F(ForeignCameras, ARigIsInAliceVisionsFileWithOneViewACamera) {
  std::vector<CalibratedCamera> rig(2, ReadOne("alicevision", Sfm(R"("pinhole")", "]")));
  rig[0].name = "left";
  rig[1].name = "right";
  rig[1].T_camera_rig = {ExpRotation({0.1, -0.2, 0.3}), {-0.1, 0.02, 0.03}};
  ExpectBack("alicevision", rig);
  // Column by column, as Eigen stores the rotation into the camera.
  const YAML::Node pose = YAML::Load(
      FindCameraFormat("alicevision", "file")->write(rig))["poses"][1]["pose"]["transform"];
  EXPECT_DOUBLE_EQ(pose["rotation"][1].as<double>(), rig[1].T_camera_rig.R(1, 0));
}

TEST_F(ForeignCameras, WhatAliceVisionCannotHoldIsRefused) {
  ExpectRefused(
      "alicevision", Sfm(R"("pinhole", "distortionType": "3deradial4")", "]"), {"'3deradial4'"});
  ExpectRefused("alicevision",
                Sfm(R"("pinhole", "undistortionType": "3declassicld")", "]"),
                {"undistortionType", "3DEqualizer"});
  ExpectRefused("alicevision",
                Sfm(R"("equidistant", "distortionType": "radialk3")", "]"),
                {"'equidistant radialk3'"});
  ExpectRefused("alicevision", Sfm(R"("equidistant")", "]"), {"fisheyeCircleRadius"});
  ExpectRefused("alicevision", Sfm(R"("pinhole")", "]", "1"), {"version", "1.2.2"});
}

// --- Metashape: manual 1.5, appendix C.
TEST_F(ForeignCameras, MetashapesLensesProjectAsThere) {
  // ezwelty/glimpse, tests/agisoft.xml, with smaller coefficients.
  const std::string xml = R"(<?xml version="1.0" encoding="UTF-8"?>
<calibration>
  <projection>frame</projection>
  <width>4288</width>
  <height>2848</height>
  <f>3570</f>
  <cx>3</cx>
  <cy>4</cy>
  <b1>7</b1>
  <b2>15</b2>
  <k1>0.03</k1>
  <k2>-0.02</k2>
  <k3>0.01</k3>
  <k4>-0.001</k4>
  <p1>0.002</p1>
  <p2>-0.001</p2>
  <date>2020-05-06T21:47:42Z</date>
</calibration>
)";
  // (0.5, 0.5) is the centre of the first pixel there.
  const auto project = [](const Eigen::Vector2d& m, double p1, double p2, double b2) {
    const Eigen::Vector2d d =
        Radtan({m.x(), m.y(), 1}, {0.03, -0.02, 0.01, -0.001}, /*p_1=*/p2, /*p_2=*/p1);
    return Eigen::Vector2d(4288 * 0.5 + 3 + d.x() * 3570 + d.x() * 7 + d.y() * b2 - 0.5,
                           2848 * 0.5 + 4 + d.y() * 3570 - 0.5);
  };
  const std::map<std::string, std::function<double(double)>> radii{
      {"frame", [](double t) { return std::tan(t); }},
      {"fisheye", [](double t) { return t; }},
      {"equidistant_fisheye", [](double t) { return t; }},
      {"equisolid_fisheye", [](double t) { return 2 * std::sin(t / 2); }}};
  for (const auto& [projection, radius] : radii) {
    SCOPED_TRACE(projection);
    const CalibratedCamera camera =
        ReadOne("metashape", Replaced(xml, ">frame<", ">" + projection + "<"));
    const auto& of = radius;
    ExpectProjects(camera, projection == "frame" ? 40 : 85, [&](const Eigen::Vector3d& p) {
      return project(Fisheye(p, of), 0.002, -0.001, 15);
    });
    ExpectBack("metashape", {camera});
  }
  // Without what is zero, inside of a document.
  const CalibratedCamera of_document = ReadOne("metashape", R"(<document version="2.0.0"><chunk>
<sensors next_id="1"><sensor id="0" label="FC550" type="frame"><resolution width="4608" height="3456"/>
<calibration type="frame" class="adjusted"><resolution width="4608" height="3456"/><f>4317.82144109411</f>
<cx>54.3448479006764</cx><cy>3.5478801249494</cy><k1>0.0167015604921295</k1><k2>-0.0239416622459823</k2>
<k3>0.0363031944008484</k3><p1>0.0035044847840485</p1><p2>0.00103698463015268</p2></calibration></sensor>
</sensors></chunk></document>)");
  EXPECT_EQ(of_document.model->name, "pinhole-radtan");
  EXPECT_EQ(of_document.image_size, (ImageSize{4608, 3456}));
  EXPECT_NEAR(of_document.params[2], 4608 / 2. + 54.3448479006764 - 0.5, kSame);
  EXPECT_EQ(of_document.params[6], 0.00103698463015268);  // p_1 is their p2
  const CalibratedCamera panorama = ReadOne(
      "metashape",
      "<calibration><projection>spherical</projection><width>2000</width><height>1000</height>"
      "</calibration>");
  ExpectProjects(panorama, 170, [](const Eigen::Vector3d& p) {
    const double f = 2000 / (2 * std::numbers::pi);
    return Eigen::Vector2d(1000 + f * std::atan2(p.x(), p.z()) - 0.5,
                           500 + f * std::atan(p.y() / std::hypot(p.x(), p.z())) - 0.5);
  });
  ExpectBack("metashape", {panorama});
}

TEST_F(ForeignCameras, WhatMetashapeCannotHoldIsRefused) {
  const std::string xml =
      "<calibration><projection>frame</projection><width>640</width><height>480</height><f>500</f>"
      "<p1>0.01</p1><p3>0</p3></calibration>";
  EXPECT_EQ(ReadOne("metashape", xml).model->name, "pinhole-radtan4");
  ExpectRefused("metashape", Replaced(xml, "<p3>0<", "<p3>0.1<"), {"<p3>"});
  ExpectRefused("metashape", Replaced(xml, "frame", "cylindrical"), {"'cylindrical'"});
  ExpectRefused("metashape", Replaced(xml, "640", "x"), {"<width>", "'x'"});
  ExpectRefused("metashape", Replaced(xml, "<f>500</f>", ""), {"<f>"});
  ExpectRefused("metashape", "<document></document>", {"<calibration>"});
}

// --- Aria: FisheyeRadTanThinPrism.h, KannalaBrandtK3.h; the numbers are those of
// projectaria_tools, camera_projections/test/CameraProjectionTest.cpp.
std::string Aria(const std::string& label, const std::string& name, const std::string& params) {
  return R"({"DeviceClassInfo": {}, "CameraCalibrations": [{"Calibrated": true, "Label": ")" +
         label + R"(", "SerialNumber": "0072510f", "Projection": {"Name": ")" + name +
         R"(", "Params": [)" + params +
         R"(]}, "T_Device_Camera": {"Translation": [0.01, -0.02, 0.03],
"UnitQuaternion": [0.8, [0.6, 0, 0]]}}]})";
}
constexpr const char* kAriaRadial =
    "-0.02689165420917155, 0.1019919163316408, -0.07180862612716554, 0.01245898233008245, "
    "0.001242086400994195, -0.0004149914187376608";
constexpr const char* kAriaTangential = "0.0005499786009926172, 0.0005819661606400815";
constexpr const char* kAriaPrism =
    "-0.001232007804086031, -0.0003868334860997226, -0.0005963449586486949, 1.071922498768078e-05";

TEST_F(ForeignCameras, AriasLensesProjectAsThere) {
  const auto project = [](const Eigen::Vector3d& p, double f_u, double f_v, bool prism) {
    const double k[]{-0.02689165420917155,
                     0.1019919163316408,
                     -0.07180862612716554,
                     0.01245898233008245,
                     0.001242086400994195,
                     -0.0004149914187376608};
    const Eigen::Vector2d r = Fisheye(p, [&](double th) {
      double series = th, power = th;
      for (const double k_i : k) series += k_i * (power *= th * th);
      return series;
    });
    const double rd2 = r.squaredNorm(), p_0 = 0.0005499786009926172, p_1 = 0.0005819661606400815;
    Eigen::Vector2d uv = r;
    uv.x() += (2 * r.x() * r.x() + rd2) * p_0 + 2 * r.x() * r.y() * p_1;
    uv.y() += (2 * r.y() * r.y() + rd2) * p_1 + 2 * r.x() * r.y() * p_0;
    if (prism) {
      uv.x() += -0.001232007804086031 * rd2 - 0.0003868334860997226 * rd2 * rd2;
      uv.y() += -0.0005963449586486949 * rd2 + 1.071922498768078e-05 * rd2 * rd2;
    }
    return Eigen::Vector2d(f_u * uv.x() + 319.8053191211108, f_v * uv.y() + 240.9679064324467);
  };
  const std::string centre = "319.8053191211108, 240.9679064324467, ";
  const std::string lens = fmt::format("{}{}, {}", centre, kAriaRadial, kAriaTangential);
  const auto check =
      [&](const std::string& name, const std::string& params, double f_v, bool prism) {
        CalibratedCamera camera = ReadOne("aria", Aria("camera-slam-left", name, params));
        EXPECT_EQ(camera.image_size, (ImageSize{640, 480}));
        EXPECT_EQ(camera.name, "camera-slam-left");
        if (f_v == 243) {  // projectaria-tools 2.3.0 would read it with a shifted centre
          ExpectNotWritten("aria", camera, {"one focal length", "243"});
        } else {
          ExpectBack("aria", {camera});
        }
        camera.T_camera_rig = {};
        ExpectProjects(camera, 70, [&](const Eigen::Vector3d& p) {
          return project(p, 242.0503165415735, f_v, prism);
        });
      };
  check("FisheyeRadTanThinPrism",
        fmt::format("242.0503165415735, {}, {}", lens, kAriaPrism),
        242.0503165415735,
        true);
  check("FisheyeRadTanThinPrism",
        fmt::format("242.0503165415735, 243, {}, {}", lens, kAriaPrism),
        243,
        true);
  check("Fisheye62", "242.0503165415735, " + lens, 242.0503165415735, false);
  CalibratedCamera kb =
      ReadOne("aria",
              Aria("camera-rgb",
                   "KannalaBrandtK3",
                   "556.9648709428538, 555.9836002606175, 319.5000821079618, 239.500905501914, "
                   "0.03981131761869532, -0.03980438501559722, 0.1244291105385938, "
                   "-0.2780730001905606"));
  EXPECT_EQ(kb.image_size, (ImageSize{2880, 2880}));
  ExpectBack("aria", {kb});
  // T_Device_Camera maps the camera's centre to its place in the device.
  EXPECT_LT((kb.T_camera_rig * Eigen::Vector3d(0.01, -0.02, 0.03)).norm(), kRotation);
  EXPECT_NEAR((kb.T_camera_rig.R.transpose() * Eigen::Vector3d::UnitY()).z(), 0.96, kRotation);
  kb.T_camera_rig = {};
  ExpectProjects(kb, 40, [](const Eigen::Vector3d& p) {
    const Eigen::Vector2d m = Fisheye(p, [](double t) {
      return t * (1 + 0.03981131761869532 * std::pow(t, 2) - 0.03980438501559722 * std::pow(t, 4) +
                  0.1244291105385938 * std::pow(t, 6) - 0.2780730001905606 * std::pow(t, 8));
    });
    return Eigen::Vector2d(556.9648709428538 * m.x() + 319.5000821079618,
                           555.9836002606175 * m.y() + 239.500905501914);
  });
}

TEST_F(ForeignCameras, WhatAriaCannotHoldIsRefused) {
  const std::string params = "242, 320, 240, 0, 0, 0, 0, 0, 0, 0, 0";
  EXPECT_EQ(ReadCameras("aria", Aria("left", "Fisheye62", params), "file", ImageSize{64, 48})
                .at(0)
                .image_size,
            (ImageSize{64, 48}));
  ExpectRefused("aria", Aria("left", "Fisheye62", params), {"Label", "--size"});
  ExpectRefused("aria", Aria("camera-rgb", "Fisheye62", "242, 320"), {"Params", "11 or 12"});
  ExpectRefused("aria", Aria("camera-rgb", "Linear", params), {"'Linear'"});
  // As projectaria-tools 2.3.0 writes it, with the size.
  const std::string sized =
      Replaced(Aria("camera-rgb", "Fisheye62", params),
               "\"SerialNumber\"",
               R"("ConfigData": {"ImageHeight": 1408, "ImageWidth": 1400}, "SerialNumber")");
  EXPECT_EQ(ReadOne("aria", sized).image_size, (ImageSize{1400, 1408}));
  ExpectBack("aria", {ReadOne("aria", sized)});
}

// --- OCamCalib: ocam_functions.c; the numbers are of an OCamCalib 3.0 file, with a larger d.
constexpr const char* kOcam =
    "#polynomial coefficients for the DIRECT mapping function (ocam_model.ss in MATLAB)\n\n"
    "5 -2.716972e+02 0.000000e+00 1.741744e-04 1.840940e-06 -8.024838e-10 \n\n"
    "#polynomial coefficients for the inverse mapping function (ocam_model.invpol in MATLAB)\n\n"
    "3 583.439624 470.805865 97.165132 \n\n#center: \"row\" and \"column\", starting from 0\n\n"
    "728.648728 729.090632\n\n#affine parameters \"c\", \"d\", \"e\"\n\n1.001407 -0.003 0.000221\n\n"
    "#image size: \"height\" and \"width\"\n\n1440 1400\n\n";

TEST_F(ForeignCameras, PixelsOfOCamCalibAreSeenWhereItSeesThem) {
  const CalibratedCamera camera = ReadOne("ocamcalib", kOcam);
  EXPECT_EQ(camera.model->name, "scaramuzza+skew");
  EXPECT_EQ(camera.image_size, (ImageSize{1400, 1440}));
  for (const auto& [column, row] :
       {std::pair(729., 728.), std::pair(0., 0.), std::pair(1399., 300.), std::pair(650., 1439.)}) {
    const double c = 1.001407, d = -0.003, e = 0.000221, determinant = c - d * e;
    const double x = ((row - 728.648728) - d * (column - 729.090632)) / determinant;
    const double y = (-e * (row - 728.648728) + c * (column - 729.090632)) / determinant;
    const double rho = std::hypot(x, y);
    const double z = -2.716972e+02 + 1.741744e-04 * rho * rho + 1.840940e-06 * std::pow(rho, 3) -
                     8.024838e-10 * std::pow(rho, 4);
    double u[2];
    ASSERT_TRUE(camera.model->Project(camera.params.data(),
                                      nullptr,
                                      nullptr,
                                      camera.T_camera_rig.R * Eigen::Vector3d(y, x, -z),
                                      u));
    EXPECT_NEAR(u[0], column, kSame);
    EXPECT_NEAR(u[1], row, kSame);
  }
  // The file holds no pose: the rotation about the axis is that of the affine parameters.
  CalibratedCamera alone = camera;
  alone.T_camera_rig = {};
  ExpectBack("ocamcalib", {alone});
  // The inverse polynomial that is written fits the direct one.
  const std::string text = FindCameraFormat("ocamcalib", "file")->write({alone});
  EXPECT_THAT(text, HasSubstr("a fit to 0.00"));
}

TEST_F(ForeignCameras, WhatOCamCalibCannotHoldIsRefused) {
  ExpectRefused("ocamcalib", Replaced(kOcam, "e+02 0.000000", "e+02 0.1"), {"file:3", "rho^1"});
  ExpectRefused("ocamcalib", Replaced(kOcam, "5 -2.71", "6 -2.71"), {"file:3", "as many"});
  ExpectRefused("ocamcalib", Replaced(kOcam, "5 -2.71", "5 2.71"), {"backwards"});
  ExpectRefused("ocamcalib", Replaced(kOcam, "1440 1400", ""), {"five lines"});
  ExpectRefused("ocamcalib", Replaced(kOcam, "728.648728 ", ""), {"file:11", "2 numbers"});
  ExpectNotWritten("ocamcalib", ReadOne("openmvg", SfmData("pinhole", kSfmSize)), {"ocamcalib"});
}

TEST_F(ForeignCameras, MatlabsFisheyeSeesItsPixelsAsThere) {
  // (1, 1) is the centre of the first pixel; the sensor's point is at inv(StretchMatrix) (p - c).
  const std::string json =
      R"({"MappingCoefficients": [875.3, -0.0003, 1e-7, -2e-11], "ImageSize": [1500, 2000],
"DistortionCenter": [1005.5, 745.25], "StretchMatrix": [[1.002, 0.003], [-0.004, 1]]})";
  const CalibratedCamera camera = ReadOne("matlab", json);
  EXPECT_EQ(camera.image_size, (ImageSize{2000, 1500}));
  Eigen::Matrix2d stretch;
  stretch << 1.002, 0.003, -0.004, 1;
  for (const auto& [x, y] : {std::pair(1005., 745.), std::pair(1., 1.), std::pair(1999., 300.)}) {
    const Eigen::Vector2d m = stretch.inverse() * Eigen::Vector2d(x - 1005.5, y - 745.25);
    const double rho = m.norm();
    const Eigen::Vector3d ray(
        m.x(),
        m.y(),
        875.3 - 0.0003 * rho * rho + 1e-7 * std::pow(rho, 3) - 2e-11 * std::pow(rho, 4));
    double u[2];
    ASSERT_TRUE(camera.model->Project(
        camera.params.data(), nullptr, nullptr, camera.T_camera_rig.R * ray, u));
    EXPECT_NEAR(u[0], x - 1, kSame);
    EXPECT_NEAR(u[1], y - 1, kSame);
  }
  CalibratedCamera alone = camera;
  alone.T_camera_rig = {};
  ExpectBack("matlab", {alone});
  ExpectBack("mat", {alone});
  ExpectRefused("matlab", Replaced(json, "[875.3, ", "["), {"MappingCoefficients", "4 numbers"});
  ExpectRefused("matlab", Replaced(json, "[875.3, ", "[-875.3, "), {"backwards"});
  ExpectRefused("matlab", Replaced(json, ", [-0.004, 1]]", "]"), {"StretchMatrix"});
  ExpectRefused("matlab", Replaced(json, "[1.002, 0.003]", "[-1.002, 0.003]"), {"mirrors"});
}

TEST_F(ForeignCameras, ASkewedPinholeOfMatlabIsRead) {
  const CalibratedCamera camera =
      ReadOne("matlab",
              R"({"FocalLength": [500, 510], "PrincipalPoint": [321, 241], "ImageSize": [480, 640],
"RadialDistortion": [-0.1, 0.02], "TangentialDistortion": [0.001, -0.002], "Skew": 2.5})");
  ExpectProjects(camera, 35, [](const Eigen::Vector3d& p) {
    const Eigen::Vector2d m = Radtan(p, {-0.1, 0.02}, 0.001, -0.002);
    return Eigen::Vector2d(500 * m.x() + 2.5 * m.y() + 320, 510 * m.y() + 240);
  });
  ExpectBack("matlab", {camera});
}

TEST_F(ForeignCameras, ScaramuzzaWithOneTermIsTheDivisionModel) {
  CalibratedCamera a, b;
  a.model = FindModel(CameraModels(), "scaramuzza");
  a.params = {250, 252, 322, 243, -0.22, 0, 0};
  b.model = FindModel(CameraModels(), "division");
  b.params = {250, 252, 322, 243, -0.22};
  ExpectProjects(a, 150, [&](const Eigen::Vector3d& p) {
    double u[2];
    EXPECT_TRUE(b.model->Project(b.params.data(), nullptr, nullptr, p, u));
    return Eigen::Vector2d(u[0], u[1]);
  });
}

// --- CAHVOR: mrcal.c (project with LENSMODEL_CAHVOR), cahvor.py.
TEST_F(ForeignCameras, CahvorProjectsAsInMrcal) {
  const std::vector<double> k{2000, 2010, 1000, 800, 0.03, -0.05, 0.02, -0.3, 0.1};
  const std::string text =
      "{ 'lensmodel': 'LENSMODEL_CAHVOR', 'intrinsics': [2000, 2010, 1000, 800, 0.03, -0.05, 0.02, "
      "-0.3, 0.1],\n'extrinsics': [0.1, -0.2, 0.3, 1, 2, 3], 'imagersize': [2000, 1600] }\n";
  const CalibratedCamera camera = ReadOne("mrcal", text);
  EXPECT_EQ(camera.model->name, "pinhole-radial3+tilt+skew");
  const RigidTransform T{ExpRotation({0.1, -0.2, 0.3}), {1, 2, 3}};
  const auto project = [&](const Eigen::Vector3d& in_rig) {
    const Eigen::Vector3d p = T * in_rig;
    const Eigen::Vector3d o(
        std::sin(k[4]) * std::cos(k[5]), std::sin(k[5]), std::cos(k[4]) * std::cos(k[5]));
    const double omega = p.dot(o);
    const Eigen::Vector3d lambda = p - omega * o;
    const double tau = lambda.squaredNorm() / (omega * omega);
    const Eigen::Vector3d moved = p + (k[6] + k[7] * tau + k[8] * tau * tau) * lambda;
    return Eigen::Vector2d(k[0] * moved.x() / moved.z() + k[2],
                           k[1] * moved.y() / moved.z() + k[3]);
  };
  ExpectProjects(camera, 28, project);
  // As .cahvor.
  Write("camera.cahvor", FindCameraFormat("mrcal", "camera.cahvor")->write({camera}));
  const CameraFormat& format = *FindCameraFormat("mrcal", "camera.cahvor");
  EXPECT_EQ(format.name, "cahvor");
  ExpectProjects(ReadCameraFile(format, {Path("camera.cahvor"), {}}).at(0), 28, project);
  if (std::system("/usr/bin/python3 -c 'import mrcal' 2>/dev/null") != 0) {
    GTEST_SKIP() << "no python3-mrcal";
  }
  Write("project.py", R"(
import mrcal, numpy as np
m = mrcal.cameramodel('camera.cahvor')
assert m.intrinsics()[0] == 'LENSMODEL_CAHVOR', m.intrinsics()[0]
p = np.array([[0.4 * np.sin(i), 0.3 * np.cos(3 * i), 1.0] for i in range(100)])
q = mrcal.project(p, *m.intrinsics())
r = mrcal.transform_point_Rt(m.extrinsics_Rt_toref(), p)
print('X,Y,Z,x,y')
for row in np.hstack((r, q)): print(','.join(f'{value:.17g}' for value in row))
)");
  const std::string command =
      "cd " + Path("").string() + " && /usr/bin/python3 project.py > projected.csv";
  ASSERT_EQ(std::system(command.c_str()), 0);
  const Table projected(Read("projected.csv"));
  for (size_t i = 0; i < 100; ++i) {
    const Eigen::Vector2d expected =
        project({projected.Numbers("X")[i], projected.Numbers("Y")[i], projected.Numbers("Z")[i]});
    EXPECT_NEAR(projected.Numbers("x")[i], expected.x(), kSame);
    EXPECT_NEAR(projected.Numbers("y")[i], expected.y(), kSame);
  }
}

// --- CAHVORE: Gennery 2006, equations of the moving centre; mrcal's file.
Eigen::Vector2d ProjectCahvore(const std::vector<double>& k,
                               double linearity,
                               const Eigen::Vector3d& p) {
  const Eigen::Vector3d o(
      std::sin(k[4]) * std::cos(k[5]), std::sin(k[5]), std::cos(k[4]) * std::cos(k[5]));
  const double omega = p.dot(o);
  const Eigen::Vector3d lambda = p - omega * o;
  const double r = lambda.norm();
  double least = 0, most = 1.4;  // theta: r cos(theta) = (omega - z(theta)) sin(theta)
  for (int i = 0; i < 100; ++i) {
    const double theta = (least + most) / 2, t2 = theta * theta;
    const double z = (theta / std::sin(theta) - 1) * (k[9] + k[10] * t2 + k[11] * t2 * t2);
    (r * std::cos(theta) > (omega - z) * std::sin(theta) ? least : most) = theta;
  }
  const double chi = linearity > 0   ? std::tan(linearity * least) / linearity
                     : linearity < 0 ? std::sin(linearity * least) / linearity
                                     : least,
               q = chi * chi;
  const Eigen::Vector3d moved = o + lambda / r * chi * (1 + k[6] + k[7] * q + k[8] * q * q);
  return {k[0] * moved.x() / moved.z() + k[2], k[1] * moved.y() / moved.z() + k[3]};
}

TEST_F(ForeignCameras, CahvoreOfAnyLinearityHasAMovingCentre) {
  const std::vector<double> k{
      800, 810, 1000, 800, 0.03, -0.05, 0.02, -0.03, 0.01, 0.004, -0.002, 0.001};
  const RigidTransform T{ExpRotation({0.1, -0.2, 0.3}), {1, 2, 3}};
  const std::map<double, std::string> models{{1, "pinhole"},
                                             {0, "equidistant"},
                                             {0.35, "linearity-0p35"},
                                             {-0.5, "equisolid"},
                                             {-0.71, "linearity-m0p71"}};
  for (const auto& [L, lens] : models) {
    SCOPED_TRACE(L);
    const double linearity = L;
    const CalibratedCamera camera = ReadOne(
        "mrcal",
        fmt::format("{{ 'lensmodel': 'LENSMODEL_CAHVORE_linearity={}', 'intrinsics': [{}],\n"
                    "'extrinsics': [0.1, -0.2, 0.3, 1, 2, 3], 'imagersize': [2000, 1600] }}\n",
                    linearity,
                    fmt::join(k, ", ")));
    EXPECT_EQ(camera.model->name, lens + "+pupil+radial2+tilt+skew");
    const auto project = [&](const Eigen::Vector3d& in_rig) {
      return ProjectCahvore(k, linearity, T * in_rig);
    };
    ExpectProjects(camera, 60, project);
    // As .cahvor.
    const CameraFormat& format = *FindCameraFormat("mrcal", "camera.cahvor");
    const std::string text = format.write({camera});
    Write("camera.cahvor", text);
    ExpectProjects(ReadCameraFile(format, {Path("camera.cahvor"), {}}).at(0), 60, project);
    ExpectRefused("cahvor", Replaced(text, "CAHVORE3,", "CAHVORE4,"), {"file:2:", "CAHVORE3,0.35"});
    ExpectRefused("cahvor", Replaced(text, "CAHVORE3,", "CAHVORE3,5 "), {"-1 to 1"});
    ExpectRefused("cahvor", Replaced(text, "\nE =", "\nF ="), {"'E = ...'"});
  }
}

// --- mrcal.c, project_latlon and project_stereographic.
TEST_F(ForeignCameras, LatlonAndStereographicOfMrcalAreFormulas) {
  const auto file = [](const char* lens) {
    return fmt::format(
        "{{ 'lensmodel': 'LENSMODEL_{}', 'intrinsics': [400, 410, 500, 400],\n"
        "'extrinsics': [0, 0, 0, 0, 0, 0], 'imagersize': [1000, 800] }}\n",
        lens);
  };
  const CalibratedCamera latlon = ReadOne("mrcal", file("LATLON"));
  ExpectProjects(latlon, 80, [](const Eigen::Vector3d& p) {
    return Eigen::Vector2d(400 * std::asin(p.x() / p.norm()) + 500,
                           410 * std::atan2(p.y(), p.z()) + 400);
  });
  const CalibratedCamera stereographic = ReadOne("mrcal", file("STEREOGRAPHIC"));
  ExpectProjects(stereographic, 120, [](const Eigen::Vector3d& p) {
    const Eigen::Vector2d u = 2 / (p.norm() + p.z()) * p.head<2>();
    return Eigen::Vector2d(400 * u.x() + 500, 410 * u.y() + 400);
  });
  for (const CalibratedCamera& camera : {latlon, stereographic}) {
    const std::string text = FindCameraFormat("mrcal", "a.cameramodel")->write({camera});
    EXPECT_EQ(ReadOne("mrcal", text).params, camera.params);
  }
}

TEST_F(ForeignCameras, CahvorFilesAreRead) {
  // mrcal, doc/data/figueroa-overpass-looking-S/splined-0.scale0.35.cahvor
  const std::string text =
      "Dimensions = 6016 4016\nModel = CAHV = perspective, linear\n"
      "C =   -0.0000000000   -0.0000000000   -0.0000000000\n"
      "A =    0.0000000000    0.0000000000    1.0000000000\n"
      "H =  706.6353735000    0.0000000000 3017.6396080000\n"
      "V =    0.0000000000  720.6420364000 1957.2919280000\n"
      "Hs = 706.6353735\n# this is hard-coded\nTheta = -1.5707963267948966 (-90.0 deg)\n";
  const CalibratedCamera camera = ReadOne("cahvor", text);
  EXPECT_EQ(camera.model->name, "pinhole");
  EXPECT_EQ(camera.params, (std::vector{706.6353735, 720.6420364, 3017.639608, 1957.291928}));
  ExpectRefused("cahvor", Replaced(text, "A =", "B ="), {"'A = ...'"});
  ExpectRefused("cahvor", Replaced(text, "1.0000000000\nH", "-1.0000000000\nH"), {"no camera"});
  ExpectRefused("cahvor", text + "LENSMODEL_OPENCV4 = 1 2 3 4\n", {".cameramodel"});
  CalibratedCamera skewed = camera;
  skewed.model = FindModel(CameraModels(), "pinhole-radial3+tilt+skew");
  skewed.params.insert(skewed.params.end(), {0, 0, 0, 0, 0, 0.001});
  ExpectNotWritten("cahvor", skewed, {"skew of 0.001"});
}

// --- COLMAP: sensor/models.h; ROS: OpenCV's coefficients.
TEST_F(ForeignCameras, APanoramaOfColmapHasItsSizeAsParameters) {
  const CalibratedCamera camera = ReadOne("colmap", "1 EQUIRECTANGULAR 2000 1000 2000.0 1000.0\n");
  ExpectProjects(camera, 170, [](const Eigen::Vector3d& p) {
    const double azimuth = std::atan2(p.x(), p.z());
    const double elevation = std::atan2(p.y(), std::hypot(p.x(), p.z()));
    return Eigen::Vector2d(2000 * (azimuth / (2 * std::numbers::pi) + 0.5) - 0.5,
                           1000 * (elevation / std::numbers::pi + 0.5) - 0.5);
  });
  ExpectBack("colmap", {camera});
  ExpectRefused(
      "colmap", "1 EQUIRECTANGULAR 2000 1000 2000 1000 3\n", {"file:1", "2 parameters, not 3"});
}

TEST_F(ForeignCameras, FourteenCoefficientsOfRosAreReadAndNotWritten) {
  const CalibratedCamera camera = ReadOne(
      "ros",
      "image_width: 640\nimage_height: 480\ncamera_matrix:\n  data: [500, 0, 320, 0, 510, 240, 0, 0, "
      "1]\ndistortion_model: rational_polynomial\ndistortion_coefficients:\n  data: [0.1, 0.02, "
      "0.001, 0.002, 0.01, 0.1, 0.03, 0.01, 0.001, 0.0005, -0.001, 0.0003, 0.03, -0.02]\n");
  EXPECT_EQ(camera.model->name, "pinhole-radtan12+tilt");
  ExpectNotWritten("ros", camera, {"ros", "pinhole-radtan12+tilt"});
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
