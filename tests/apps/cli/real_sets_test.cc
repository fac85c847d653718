// SPDX-License-Identifier: Apache-2.0
//
// Real and simulated image sets that are not part of the repository (docs/data.md).
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <fstream>
#include <opencv2/core/persistence.hpp>
#include <set>
#include <sstream>

#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

class RealSets : public Workspace {
 protected:
  static fs::path Set(const std::string& name) { return OptionalData(name); }

  void WriteChessboardSession(int columns,
                              int rows,
                              double square,
                              const std::vector<std::pair<std::string, std::string>>& cameras,
                              bool refine_target) const {
    Write("target.yaml",
          fmt::format("plenocal: 1\ntype: chessboard\ncolumns: {}\nrows: {}\nsquare: {}\n",
                      columns,
                      rows,
                      square));
    std::string text = "plenocal: 1\ntarget: target.yaml\ncameras:\n";
    for (const auto& [name, images] : cameras) {
      text += fmt::format("  {}:\n    model: pinhole-radial3\n    images: {}\n", name, images);
    }
    Write("session.yaml", text + fmt::format("options: {{refine_target: {}}}\n", refine_target));
  }

  // A camera whose points are in <camera>.csv.
  void WriteDetectionsSession(const std::string& camera,
                              const std::string& image_size,
                              bool refine_target) const {
    Write("session.yaml",
          fmt::format("plenocal: 1\ntarget: target.yaml\ncameras:\n  {0}: {{model: "
                      "pinhole-radial3, detections: {0}.csv, image_size: {1}}}\n"
                      "options: {{refine_target: {2}}}\n",
                      camera,
                      image_size,
                      refine_target));
  }

  [[nodiscard]] double Rms(const std::string& out, const std::string& camera) const {
    return Result(out)["cameras"][camera]["residuals"]["rms"].as<double>();
  }
};

#define SKIP_WITHOUT(path) \
  if (!fs::exists(path)) GTEST_SKIP() << Absent(path)

TEST_F(RealSets, StereoChessboardIsExplainedAsWellAsByOpenCv) {
  const fs::path set = Set("frames/stereo_chess_opencv");
  SKIP_WITHOUT(set);
  const std::vector<std::pair<std::string, std::string>> cameras{
      {"left", (set / "left*.jpg").string()}, {"right", (set / "right*.jpg").string()}};
  constexpr double kSquare = 0.025;
  WriteChessboardSession(9, 6, kSquare, cameras, false);
  Calibrate("rigid");
  // reference_opencv.json, pinhole_5.
  EXPECT_LE(Rms("rigid", "left"), 0.248);
  EXPECT_LE(Rms("rigid", "right"), 0.249);
  WriteChessboardSession(9, 6, kSquare, cameras, true);
  Calibrate("refined");
  for (const char* out : {"rigid", "refined"}) {
    const Eigen::Matrix4d T = Matrix(Result(out)["cameras"]["right"]["T_camera_rig"]);
    EXPECT_NEAR((T.topRightCorner<3, 1>().norm()) / kSquare, 3.311, 0.033) << out;
    EXPECT_LT((T.topLeftCorner<3, 3>() - Eigen::Matrix3d::Identity()).norm(), 0.03) << out;
    EXPECT_GE(Result(out)["frames"].as<int>(), 13);
  }
  EXPECT_LT(Rms("refined", "left"), Rms("rigid", "left"));
  EXPECT_LT(Rms("refined", "right"), Rms("rigid", "right"));
}

TEST_F(RealSets, AnamorphicStereoEndsInNoLocalMinimum) {
  const fs::path set = Set("frames/stereo_chess_anamorphic_drobotics");
  SKIP_WITHOUT(set);
  WriteChessboardSession(
      11,
      8,
      0.1,
      {{"left", (set / "left*.png").string()}, {"right", (set / "right*.png").string()}},
      false);
  Calibrate();
  for (const char* name : {"left", "right"}) {
    const double f_x = Result()["cameras"][name]["parameters"]["f_x"].as<double>();
    const double f_y = Result()["cameras"][name]["parameters"]["f_y"].as<double>();
    EXPECT_GT(f_x, 515) << name;
    EXPECT_LT(f_x, 535) << name;
    EXPECT_NEAR(f_x / f_y, 1.124, 0.01) << name;
    EXPECT_LT(Rms("out", name), 0.65) << name;
  }
}

TEST_F(RealSets, ACalibrationHoldsForTheOtherImagesButNotAtAnotherZoom) {
  const fs::path set = Set("frames/stereo_chess_opencv");
  SKIP_WITHOUT(set);
  // The points of a frame share errors, which both the old and the new images have once.
  for (const char* folder : {"odd", "even"}) fs::create_directory(Path(folder));
  bool is_odd = false;
  for (int number = 1; number <= 14; ++number) {
    const std::string name = fmt::format("left{:02}.jpg", number);
    if (!fs::exists(set / name)) continue;
    is_odd = !is_odd;
    fs::create_symlink(set / name, Path(is_odd ? "odd" : "even") / name);
  }
  for (const char* folder : {"odd", "even"}) {
    WriteChessboardSession(9, 6, 0.025, {{"left", fmt::format("{}/*.jpg", folder)}}, false);
    Calibrate(folder);
  }
  const Table points(Read("even/detections_left.csv"));
  const auto frame = points.Column("frame"), marker = points.Column("marker");
  const auto x = points.Numbers("x"), y = points.Numbers("y");
  for (const double zoom : {1.0, 1.03}) {
    std::string text = "frame,marker,x,y\n";
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double u = 319.5 + zoom * (x[i] - 319.5), v = 239.5 + zoom * (y[i] - 239.5);
      if (u < 0 || u > 639 || v < 0 || v > 479) continue;
      text += fmt::format("{},{},{},{}\n", frame[i], marker[i], u, v);
    }
    Write("left.csv", text);
    WriteDetectionsSession("left", "[640, 480]", false);
    const Outcome check =
        Run({"compare", "odd/calibration.yaml", "--check", "session.yaml", "--quiet"});
    EXPECT_EQ(check.status, zoom == 1 ? kDone : kJobFailed) << zoom << check.out << check.err;
  }
}

TEST_F(RealSets, AModelThatPredictsWorseIsNoReasonForAnother) {
  // The spline knows of the bend of the board, but most of its 195 parameters follow noise.
  const fs::path set = Set("frames/stereo_chess_opencv");
  SKIP_WITHOUT(set);
  WriteChessboardSession(9, 6, 0.03, {{"left", (set / "left*.jpg").string()}}, false);
  const Outcome outcome =
      Run({"try", "session.yaml", "--models", "pinhole,pinhole-radtan,splined", "-o", "out"});
  EXPECT_THAT(outcome.out, HasSubstr("\nrecommended: pinhole-radtan, "));
  const YAML::Node best = YAML::Load(Read("out/try.yaml"))["models"].begin()->second;
  EXPECT_EQ(best["held_out"]["probability"].as<double>(), 1);
}

TEST_F(RealSets, ARepeatedPictureAddsLittle) {
  const fs::path set = Set("frames/stereo_chess_opencv");
  SKIP_WITHOUT(set);
  WriteChessboardSession(9, 6, 0.025, {{"left", (set / "left*.jpg").string()}}, false);
  Calibrate();
  const std::string picture = (set / "left04.jpg").string();
  for (const std::string& image : {picture, "left=" + picture}) {
    const Outcome outcome = Run({"suggest", "out", "--image", image, "--json"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    const YAML::Node worth = YAML::Load(outcome.out);
    EXPECT_EQ(worth["points"].as<int>(), 54);
    EXPECT_LT(worth["sigma_after"].as<double>(), worth["sigma_now"].as<double>());
    EXPECT_GT(worth["share"].as<double>(), 0);
    EXPECT_LT(worth["share"].as<double>(), 0.3);
    EXPECT_THAT(worth["words"].as<std::string>(), HasSubstr("of what the best view would"));
  }
  const auto fails = [&](const std::string& image, const char* part) {
    const Outcome outcome = Run({"suggest", "out", "--image", image});
    EXPECT_EQ(outcome.status, kWrongInput) << image;
    EXPECT_THAT(outcome.err, HasSubstr(part));
  };
  fails("right=" + picture, "no camera 'right'. The calibration's cameras: left");
  fails("left=", "'left=' names no file");
  fails("left=nowhere.png", "nowhere.png");
  fails("left=session.yaml", "session.yaml");
}

TEST_F(RealSets, NoFisheyeGetsAPinholeFromFourImages) {
  const fs::path set = Set("frames/stereo_fisheye_ros");
  SKIP_WITHOUT(set);
  fs::create_directory(Path("few"));
  for (const char* number : {"06", "18", "31", "39"}) {
    const std::string name = fmt::format("right-00{}.png", number);
    ASSERT_TRUE(fs::exists(set / name)) << name;
    fs::create_symlink(set / name, Path("few") / name);
  }
  WriteChessboardSession(8, 6, 0.03, {{"right", "few/*.png"}}, false);
  const Outcome outcome =
      Run({"try", "session.yaml", "--models", "pinhole,pinhole-radial3,ucm", "-o", "out"});
  EXPECT_THAT(outcome.out, HasSubstr("\nrecommended: ucm, "));
}

TEST_F(RealSets, FisheyeThatTheModelCannotDescribeShowsInTheResiduals) {
  const fs::path set = Set("frames/mono_fisheye_camodocal");
  SKIP_WITHOUT(set);
  WriteChessboardSession(9, 6, 0.05, {{"fisheye", (set / "img*.png").string()}}, false);
  const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
  ASSERT_THAT(outcome.status, ::testing::AnyOf(kDone, kJobFailed)) << outcome.err;
  if (outcome.status == kJobFailed) {
    EXPECT_THAT(outcome.err, ::testing::HasSubstr("fisheye"));
    return;
  }
  ExpectNoNan(Result());
  const YAML::Node residuals = Result()["cameras"]["fisheye"]["residuals"];
  EXPECT_TRUE(residuals["rms"].as<double>() > 0.5 || residuals["rejected"].as<int>() > 20)
      << outcome.out;
}

// Its image is a circle: the corners are black.
TEST_F(RealSets, FisheyeHasNoFiguresWhereItFormsNoImage) {
  const fs::path set = Set("frames/mono_fisheye_camodocal");
  SKIP_WITHOUT(set);
  const Outcome outcome = Run({"calibrate",
                               (set / "img*.png").string(),
                               "--target",
                               "chessboard:9x6:30mm",
                               "--model",
                               "kannala-brandt4",
                               "-o",
                               "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("no image in the corners"));
  ExpectNoNan(Result());
}

TEST_F(RealSets, OmnidirectionalCameraShowsInTheResiduals) {
  const fs::path set = Set("frames/omni_corners_opencv");
  SKIP_WITHOUT(set);
  cv::FileStorage storage((set / "omni_calib_data.xml").string(), cv::FileStorage::READ);
  std::string markers, rows = "frame,marker,x,y\n";
  cv::Mat_<cv::Vec3d> board;
  storage["objectPoints"][0] >> board;
  for (int k = 0; k < board.rows; ++k) {
    markers += fmt::format("  {}: [{}, {}, 0]\n", k, board(k)[0], board(k)[1]);
  }
  int frame = 0;
  for (const auto& view : storage["imagePoints"]) {
    cv::Mat_<cv::Vec2f> points;
    view >> points;
    for (int k = 0; k < points.rows; ++k) {
      rows += fmt::format("{:02},{},{},{}\n", frame, k, points(k)[0], points(k)[1]);
    }
    ++frame;
  }
  Write("target.yaml", "plenocal: 1\ntype: markers\nmarkers:\n" + markers);
  Write("omni.csv", rows);
  WriteDetectionsSession("omni", "[1280, 960]", false);
  Calibrate();
  ExpectNoNan(Result());
  // The Mei model leaves 0.81 px.
  EXPECT_GT(Rms("out", "omni"), 2);
}

TEST_F(RealSets, RoomOfTagsIsSolvedFromItsDetections) {
  const fs::path set = Set("frames/tags3d_tagslam/test_13");
  SKIP_WITHOUT(set);
  // Nominal places: TagSLAM's solution. Its corners are numbered as ours.
  const auto lines_of = [&](const std::string& name) {
    std::ifstream file(set / name);
    std::vector<std::string> lines;
    for (std::string line; std::getline(file, line);) {
      if (line.starts_with("#")) continue;
      std::replace(line.begin(), line.end(), ',', ' ');
      lines.push_back(line);
    }
    return lines;
  };
  constexpr double kTolerance = 0.01;
  std::string target =
      fmt::format("plenocal: 1\ntype: markers\ntolerance: {}\nmarkers:\n", kTolerance);
  for (const std::string& line : lines_of("tags_reference.csv")) {
    std::istringstream stream(line);
    int id = 0;
    double size = 0;
    std::string body;
    Eigen::Vector3d place;
    Eigen::Quaterniond turn;
    stream >> id >> size >> body >> place.x() >> place.y() >> place.z() >> turn.x() >> turn.y() >>
        turn.z() >> turn.w();
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector3d corner(k == 1 || k == 2 ? 1 : -1, k >= 2 ? 1 : -1, 0);
      const Eigen::Vector3d p = place + turn.normalized() * (0.5 * size * corner);
      target += fmt::format("  {}: [{}, {}, {}]\n", 4 * id + k, p.x(), p.y(), p.z());
    }
  }
  Write("target.yaml", target);
  // Every fourth frame, as the reference figure.
  std::string rows = "frame,marker,x,y\n", last;
  int frame = -1;
  for (const std::string& line : lines_of("detections.csv")) {
    std::istringstream stream(line);
    std::string stamp, topic, hamming;
    int id = 0;
    stream >> stamp >> topic >> id >> hamming;
    if (stamp != last) ++frame;
    last = stamp;
    if (frame % 4 != 0) continue;
    for (int k = 0; k < 4; ++k) {
      double x = 0, y = 0;
      stream >> x >> y;
      rows += fmt::format("{},{},{},{}\n", stamp, 4 * id + k, x, y);
    }
  }
  Write("camera.csv", rows);
  WriteDetectionsSession("camera", "[2048, 2048]", true);
  Calibrate();
  // reference_opencv.json: 12952 corners of 170 frames, RMS 0.316 px with every tag a rigid square,
  // f 1497.8 and 1498.0 px.
  EXPECT_EQ(Result()["frames"].as<int>(), 170);
  const YAML::Node camera = Result()["cameras"]["camera"];
  EXPECT_GT(camera["residuals"]["points"].as<int>(), 0.98 * 12952);
  EXPECT_LT(Rms("out", "camera"), 0.316);
  for (const char* name : {"f_x", "f_y"}) {
    EXPECT_NEAR(camera["parameters"][name].as<double>(), 1497.9, 3) << name;
  }
}

// Marker positions by number.
std::map<std::string, Eigen::Vector3d> Markers(const YAML::Node& target) {
  std::map<std::string, Eigen::Vector3d> markers;
  const auto vector = [](const YAML::Node& node) {
    return Eigen::Vector3d(node[0].as<double>(), node[1].as<double>(), node[2].as<double>());
  };
  for (const auto& tag : target["tags"]) {
    for (int k = 0; k < 4; ++k) {
      markers[std::to_string(4 * tag["id"].as<int>() + k)] = vector(tag["corners"][k]);
    }
  }
  for (const auto& entry : target["markers"]) {
    markers[entry.first.as<std::string>()] = vector(entry.second);
  }
  return markers;
}

// Root of the mean square distance after the best rigid alignment.
double DistanceAfterAlignment(const std::map<std::string, Eigen::Vector3d>& a,
                              const std::map<std::string, Eigen::Vector3d>& b) {
  Eigen::Matrix3Xd from(3, a.size()), to(3, a.size());
  Eigen::Index i = 0;
  for (const auto& [number, position] : a) {
    from.col(i) = position;
    to.col(i++) = b.at(number);
  }
  const Eigen::Matrix4d T = Eigen::umeyama(from, to, false);
  const Eigen::Matrix3Xd rest =
      ((T.topLeftCorner<3, 3>() * from).colwise() + T.topRightCorner<3, 1>()) - to;
  return std::sqrt(rest.squaredNorm() / static_cast<double>(rest.cols()));
}

TEST_F(RealSets, SimulatedStereoRigIsFoundWithinItsSigmas) {
  const fs::path set = Set("sim_small");
  SKIP_WITHOUT(set);
  std::string text =
      fmt::format("plenocal: 1\ntarget: {}\ncameras:\n", (set / "target.yaml").string());
  for (const char* name : {"left", "right"}) {
    text += fmt::format("  {}:\n    model: pinhole-radial3\n    images: {}\n",
                        name,
                        (set / name / "*.png").string());
  }
  Write("session.yaml", text + "options: {refine_target: true}\n");
  Calibrate();
  const YAML::Node truth = YAML::LoadFile((set / "truth/calibration.yaml").string())["cameras"];
  constexpr double kSigmas = 3;
  for (const char* name : {"left", "right"}) {
    const YAML::Node camera = Result()["cameras"][name];
    for (const auto& param : camera["parameters"]) {
      const auto key = param.first.as<std::string>();
      EXPECT_NEAR(param.second.as<double>(),
                  truth[name]["parameters"][key].as<double>(),
                  kSigmas * camera["sigma"][key].as<double>())
          << name << " " << key;
    }
  }
  const YAML::Node right = Result()["cameras"]["right"];
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(right["xi_camera_rig"][i].as<double>(),
                truth["right"]["xi_camera_rig"][i].as<double>(),
                kSigmas * right["sigma_xi"][i].as<double>())
        << "xi " << i;
  }
  const auto true_markers = Markers(YAML::LoadFile((set / "truth/target.yaml").string()));
  const auto nominal = Markers(YAML::LoadFile((set / "target.yaml").string()));
  const auto refined = Markers(YAML::Load(Read("out/target.yaml")));
  EXPECT_LT(DistanceAfterAlignment(refined, true_markers),
            0.5 * DistanceAfterAlignment(nominal, true_markers));
}

TEST_F(RealSets, PlenopticCameraAndStereoRigFromRawImages) {
  const fs::path set = Set("sim_small");
  SKIP_WITHOUT(set);
  const Outcome outcome = Run({"calibrate", (set / "session.yaml").string(), "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  ExpectNoNan(Result());
  const YAML::Node truth =
      YAML::LoadFile((set / "truth/calibration.yaml").string())["cameras"]["plenoptic"];
  const YAML::Node camera = Result()["cameras"]["plenoptic"];
  // Twice the error of an independent, near-optimal registration of the same images. The bound of
  // f_L is three standard errors, below (3e-4).
  const std::map<std::string, double> bounds{{"b_L0", 2.4e-4}, {"B", 0.011}};
  for (const auto& [key, relative] : bounds) {
    const auto true_value = truth["parameters"][key].as<double>();
    EXPECT_NEAR(camera["parameters"][key].as<double>() / true_value, 1, relative) << key;
  }
  constexpr double kSigmas = 3;
  for (const auto& param : camera["parameters"]) {
    const auto key = param.first.as<std::string>();
    EXPECT_NEAR(param.second.as<double>(),
                truth["parameters"][key].as<double>(),
                kSigmas * camera["sigma"][key].as<double>())
        << key;
  }
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(camera["xi_camera_rig"][i].as<double>(),
                truth["xi_camera_rig"][i].as<double>(),
                kSigmas * camera["sigma_xi"][i].as<double>())
        << "xi " << i;
  }
  // What a marker's micro images have in common is no error of their own: neighbouring tags, say.
  EXPECT_LT(camera["residuals"]["rms"].as<double>(),
            1.15 * camera["residuals"]["floor"].as<double>());
  for (const char* key : {"micro_lenses", "vignetting"}) {
    EXPECT_TRUE(fs::exists(Path("out") / camera[key].as<std::string>())) << key;
  }
  // Its three types are in focus at these virtual depths (SOURCE.md of the set).
  std::set<double> found;
  for (const YAML::Node& type : camera["lens_types"]) {
    const auto f = type["focal_length"].as<double>();
    for (const double v : {2.5, 3.2, 4.4}) {
      const double off = f / (truth["parameters"]["B"].as<double>() * v / (v - 1)) - 1;
      if (std::abs(off) < 0.01) found.insert(v);
    }
  }
  EXPECT_EQ(found.size(), 3u);
}

TEST_F(RealSets, PlenopticCameraFromRealMicroImagePoints) {
  const fs::path set = Set("plenoptic_real/r12a");
  SKIP_WITHOUT(set);
  // SOURCE.md: 0.668 px a coordinate with a refined board, 0.716 with a flat one; f_L = 51.7 mm.
  const auto calibrate = [&](bool refine) {
    Write("session.yaml",
          fmt::format("plenocal: 1\ntarget: {0}/target.yaml\ncameras:\n  r12:\n"
                      "    model: focused-plenoptic\n    detections: {0}/detections.csv\n"
                      "    image_size: [4080, 3068]\n    pixel_size: 5.5e-6\n"
                      "    fixed: [B_0, B_1]\noptions: {{refine_target: {1}}}\n",
                      set.string(),
                      refine));
    Calibrate();
    return Rms("out", "r12") / std::sqrt(2);
  };
  EXPECT_GE(calibrate(false), 0.68);  // without the points that are rejected
  EXPECT_LE(calibrate(true), 0.670);
  EXPECT_NEAR(Result()["cameras"]["r12"]["parameters"]["f_L"].as<double>(), 0.0517, 3e-4);
  double low = 0, high = 0;
  for (const auto& [number, position] : Markers(YAML::Load(Read("out/target.yaml")))) {
    low = std::min(low, position.z());
    high = std::max(high, position.z());
  }
  EXPECT_NEAR(low, -0.34e-3, 0.05e-3);
  EXPECT_NEAR(high, 0.39e-3, 0.05e-3);
  const YAML::Node residuals = Result()["cameras"]["r12"]["residuals"];
  EXPECT_NEAR(residuals["floor_all"].as<double>() / std::sqrt(2), 0.668, 0.001);
  EXPECT_NEAR(residuals["floor_all_third_order"].as<double>() / std::sqrt(2), 0.646, 0.002);
  EXPECT_EQ(residuals["rms_by_type"].size(), 3U);
}

TEST_F(RealSets, ForeignGridsAndWhiteImagesOfAnotherFocusAreNamed) {
  const fs::path set = Set("plenoptic_real");
  const fs::path lfm = Set("scene_real/lfm_guv_square");
  SKIP_WITHOUT(set);
  SKIP_WITHOUT(lfm);
  const Outcome foreign = Run({"focus",
                               set / "plenoptic_toolbox2/sc2_klein.png",
                               "--grid",
                               set / "raytrix_xml_mit/tree_Calibration.xml",
                               "-o",
                               "out"});
  EXPECT_EQ(foreign.status, kJobFailed);
  EXPECT_THAT(foreign.err, HasSubstr("if the grid is of this camera"));
  // By the edges of the micro images, halfway between brightness and gap: (-0.19, 0.29) px.
  EXPECT_THAT(Run({"focus",
                   lfm / "Lightfield_GUVExperim1.tif",
                   "--white",
                   lfm / "Radiometry_GUVExperim1.tif",
                   "-o",
                   "out"})
                  .err,
              HasSubstr("displacement -0.19, +0.34 px"));
}

// Rays traced through three published lens designs without noise. SOURCE.md: RMS of a coordinate
// with third order over all points; a few are rejected here.
TEST_F(RealSets, PlenopticCamerasBehindRealLenses) {
  for (const auto& [lens, size, rms] : {std::tuple{"mandler_16mm", 1712, 0.0243},
                                        {"tronnier_16mm", 1712, 0.0399},
                                        {"tronnier_50mm", 2948, 0.0387}}) {
    const fs::path set = Set(fmt::format("plenoptic_real/lens_prescriptions/{}", lens));
    SKIP_WITHOUT(set);
    Write("session.yaml",
          fmt::format("plenocal: 1\ntarget: {0}/target.yaml\ncameras:\n  plenoptic:\n"
                      "    model: plenoptic-thick\n    detections: {0}/detections_exact.csv\n"
                      "    image_size: [{1}, {1}]\n    pixel_size: 5.5e-6\n"
                      "options: {{refine_target: false, loss: none}}\n",
                      set.string(),
                      size));
    Calibrate();
    const YAML::Node residuals = Result()["cameras"]["plenoptic"]["residuals"];
    EXPECT_NEAR(residuals["rms_all"].as<double>() / std::sqrt(2) / rms, 1.05, 0.06) << lens;
    EXPECT_LT(residuals["floor_third_order"].as<double>(), 0.7 * residuals["floor"].as<double>());
  }
}

// Two calibrations without a frame in common: SOURCE.md's warp and f_L come from both.
TEST_F(RealSets, PlenopticCameraFromTheEvenAndTheOddFrames) {
  const fs::path set = Set("plenoptic_real/r12a");
  SKIP_WITHOUT(set);
  std::ifstream file(set / "detections.csv");
  std::string header, rows[2];
  std::getline(file, header);
  for (std::string row; std::getline(file, row);) {
    rows[std::stoi(row.substr(1)) % 2] += row + "\n";
  }
  double f_L[2], sigma[2];
  std::map<std::string, Eigen::Vector3d> markers[2];
  for (const size_t half : {0, 1}) {
    Write("half.csv", header + "\n" + rows[half]);
    Write("session.yaml",
          fmt::format("plenocal: 1\ntarget: {0}/target.yaml\ncameras:\n  r12:\n"
                      "    model: focused-plenoptic\n    detections: half.csv\n"
                      "    image_size: [4080, 3068]\n    pixel_size: 5.5e-6\n"
                      "    fixed: [B_0, B_1]\noptions: {{refine_target: true}}\n",
                      set.string()));
    Calibrate();
    const YAML::Node camera = Result()["cameras"]["r12"];
    f_L[half] = camera["parameters"]["f_L"].as<double>();
    sigma[half] = camera["sigma"]["f_L"].as<double>();
    markers[half] = Markers(YAML::Load(Read("out/target.yaml")));
  }
  EXPECT_LT(std::abs(f_L[0] - f_L[1]), 2 * std::hypot(sigma[0], sigma[1]));
  double squares = 0;
  for (const auto& [number, position] : markers[0]) {
    squares += std::pow(position.z() - markers[1].at(number).z(), 2);
  }
  EXPECT_LT(std::sqrt(squares / static_cast<double>(markers[0].size())), 0.05e-3);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
