// SPDX-License-Identifier: Apache-2.0
//
// `plenocal compare` and `plenocal convert`, and the calibration.yaml that they read.
#include <fmt/format.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include "calib/camera/rigid_transform.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::Not;

class CompareCommand : public Workspace {
 protected:
  // Calibrates one camera twice, from the even and from the odd of its frames.
  void CalibrateHalves() const {
    SyntheticProblem problem = MakeProblem(3, {.cameras = 1, .frames = 24, .noise = 0.1});
    const std::vector<View> views = problem.input.cameras[0].views;
    for (const size_t half : {0, 1}) {
      problem.input.cameras[0].views.clear();
      for (size_t i = half; i < views.size(); i += 2) {
        problem.input.cameras[0].views.push_back(views[i]);
      }
      WriteProblem(problem);
      Calibrate(half == 0 ? "a" : "b");
    }
  }
  // A copy of a calibration with one parameter changed.
  void Change(const std::string& from,
              const std::string& to,
              const std::string& name,
              double by) const {
    YAML::Node file = YAML::Load(Read(from));
    YAML::Node value = file["cameras"].begin()->second["parameters"][name];
    value = value.as<double>() + by;
    Write(to, YAML::Dump(file) + "\n");
  }
};

TEST_F(CompareCommand, FindsTwoHalvesOfARecordingTheSameAndAChangedCameraNot) {
  CalibrateHalves();
  const Outcome same = Run({"compare", "a/calibration.yaml", "b/calibration.yaml"});
  EXPECT_EQ(same.status, kDone) << same.err;
  EXPECT_THAT(same.out, HasSubstr("\nsame within uncertainty\n"));

  // Ten sigmas of the focal length are taken up by no turn and no shift.
  const double sigma = Result("b")["cameras"].begin()->second["sigma"]["f_x"].as<double>();
  Change("b/calibration.yaml", "changed.yaml", "f_x", 10 * sigma);
  const Outcome changed = Run({"compare", "a/calibration.yaml", "changed.yaml"});
  EXPECT_EQ(changed.status, kDone) << changed.err;
  EXPECT_THAT(changed.out, HasSubstr("not the same within uncertainty"));
  EXPECT_THAT(changed.out, HasSubstr("differs"));

  // Ten sigmas of one file are ten over the root of two of the difference between two such files.
  const Outcome moved = Run({"compare", "b/calibration.yaml", "changed.yaml"});
  std::string line;
  for (const std::string& each : Lines(moved.out)) {
    if (each.starts_with("  f_x ")) line = each;
  }
  EXPECT_TRUE(line.ends_with(" -7.1")) << line;
}

TEST_F(CompareCommand, TakesOutWhatATurnOfTheCameraExplains) {
  CalibrateHalves();
  // A principal point that lies elsewhere is, far away and in the first order, a turn.
  const YAML::Node camera = Result("a")["cameras"].begin()->second;
  const double f_x = camera["parameters"]["f_x"].as<double>();
  Change("a/calibration.yaml", "moved.yaml", "c_x", 1);
  const Outcome outcome = Run({"compare", "a/calibration.yaml", "moved.yaml", "--distance", "inf"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  const std::string turn = outcome.out.substr(outcome.out.find("a rotation vector ("));
  double x = 0, y = 0;
  ASSERT_EQ(std::sscanf(turn.c_str(), "a rotation vector (%lf, %lf", &x, &y), 2) << outcome.out;
  // Where the lens compresses the border, a pixel is more of a turn.
  EXPECT_GT(std::abs(y), 0.8 * 180 / M_PI / f_x);
  EXPECT_LT(std::abs(y), 2 * 180 / M_PI / f_x);
  EXPECT_LT(std::abs(x), 0.1 * std::abs(y));
}

TEST_F(CompareCommand, ComparesRigsAndSaysWhereCamerasStand) {
  WriteProblem(EasyProblem(2));
  Calibrate("rig");
  const Outcome outcome = Run({"compare", "rig/calibration.yaml", "rig/calibration.yaml"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("on the rig: turned by 0.0000 degrees"));
  EXPECT_THAT(outcome.out, HasSubstr("\nsame within uncertainty\n"));
  EXPECT_THAT(outcome.out, Not(HasSubstr("without the correlations")));

  // The turn's sigma without what correlates places and principal points.
  const auto turn_sigma = [](const std::string& text) {
    double sigma = 0;
    const std::string found = text.substr(text.find("degrees (sigmas: "));
    EXPECT_EQ(std::sscanf(found.c_str(), "degrees (sigmas: %lf", &sigma), 1) << text;
    return sigma;
  };
  std::filesystem::create_directory(Path("alone"));
  Write("alone/calibration.yaml", Read("rig/calibration.yaml"));
  const Outcome alone = Run({"compare", "rig/calibration.yaml", "alone/calibration.yaml"});
  EXPECT_EQ(alone.status, kDone) << alone.err;
  EXPECT_THAT(alone.out, HasSubstr("without the correlations"));
  EXPECT_GT(turn_sigma(alone.out), 1.2 * turn_sigma(outcome.out));
  WriteProblem(EasyProblem(3));
  Calibrate("other");
  Write("alone/correlations.csv", Read("other/correlations.csv"));
  const Outcome mixed = Run({"compare", "rig/calibration.yaml", "alone/calibration.yaml"});
  EXPECT_EQ(mixed.status, kWrongInput);
  EXPECT_THAT(mixed.err, HasSubstr("alone/correlations.csv: is of another calibration"));

  // What is exact needs none.
  YAML::Node exact = YAML::Load(Read("rig/calibration.yaml"));
  for (auto camera : exact["cameras"]) {
    for (const char* key : {"sigma", "correlation", "sigma_xi"}) camera.second.remove(key);
  }
  Write("exact.yaml", YAML::Dump(exact) + "\n");
  const Outcome against_truth = Run({"compare", "rig/calibration.yaml", "exact.yaml"});
  EXPECT_EQ(against_truth.status, kDone) << against_truth.err;
  EXPECT_THAT(against_truth.out, Not(HasSubstr("without the correlations")));
}

TEST_F(CompareCommand, SaysThatACameraStandsElsewhereOnTheRig) {
  WriteProblem(EasyProblem(2));
  Calibrate("rig");
  YAML::Node file = YAML::Load(Read("rig/calibration.yaml"));
  const std::string master = file["cameras"].begin()->first.as<std::string>();
  YAML::Node camera;
  for (const auto& each : file["cameras"]) camera.reset(each.second);
  // Moved along x by ten of its sigmas.
  const double by = 10 * camera["sigma_xi"][0].as<double>();
  RigidTransform T;
  T.R = Matrix(camera["T_camera_rig"]).topLeftCorner<3, 3>();
  T.t = Matrix(camera["T_camera_rig"]).topRightCorner<3, 1>();
  T.t.x() += by;
  const Vector6d xi = Log(T);
  camera["T_camera_rig"][0][3] = T.t.x();
  for (int i = 0; i < 6; ++i) camera["xi_camera_rig"][i] = xi[i];
  Write("moved.yaml", YAML::Dump(file) + "\n");
  const Outcome moved = Run({"compare", "rig/calibration.yaml", "moved.yaml"});
  EXPECT_EQ(moved.status, kDone) << moved.err;
  EXPECT_THAT(moved.out, HasSubstr(": more than the sigmas explain\n"));
  EXPECT_THAT(moved.out, HasSubstr("\nnot the same within uncertainty\n"));

  // The other camera alone.
  file["cameras"].remove(master);
  Write("one.yaml", YAML::Dump(file) + "\n");
  const Outcome one = Run({"compare", "rig/calibration.yaml", "one.yaml"});
  EXPECT_EQ(one.status, kDone) << one.err;
  EXPECT_THAT(one.out, HasSubstr("not compared, only in rig/calibration.yaml: " + master + "\n"));
  EXPECT_THAT(one.out, HasSubstr("\nsame within uncertainty\n"));
}

TEST_F(CompareCommand, MapsCamerasOfOtherNames) {
  WriteProblem(EasyProblem(2));
  Calibrate("rig");
  const Outcome same = Run({"compare", "rig/calibration.yaml", "rig/calibration.yaml"});
  std::filesystem::create_directory(Path("renamed"));
  for (const char* file : {"calibration.yaml", "correlations.csv"}) {
    std::string text = Read(fmt::format("rig/{}", file));
    for (const auto& [from, to] : {std::pair("cam0", "left"), std::pair("cam1", "right")}) {
      for (size_t at = 0; (at = text.find(from, at)) != std::string::npos;) {
        text.replace(at, std::string(from).size(), to);
      }
    }
    Write(fmt::format("renamed/{}", file), text);
  }
  const std::vector<std::string> compare{
      "compare", "rig/calibration.yaml", "renamed/calibration.yaml"};
  const auto with_map = [&](const std::string& map) {
    std::vector<std::string> arguments = compare;
    arguments.insert(arguments.end(), {"--map", map});
    return Run(arguments);
  };
  const Outcome without = Run(compare);
  EXPECT_EQ(without.status, kWrongInput);
  EXPECT_THAT(without.err, HasSubstr("--map cam0=left,cam1=right"));
  const Outcome mapped = with_map("cam0=left,cam1=right");
  EXPECT_EQ(mapped.status, kDone) << mapped.err;
  // As with equal names; the correlations are found under the other names too.
  EXPECT_EQ(mapped.out, same.out);

  const Outcome one = with_map("cam1=right");
  EXPECT_EQ(one.status, kDone) << one.err;
  EXPECT_THAT(one.out, HasSubstr("not compared, only in renamed/calibration.yaml: left\n"));
  EXPECT_THAT(one.out, HasSubstr("--map cam0=left"));
  for (const auto& [map, message] : {std::pair("cam0", "NAME=NAME"),
                                     std::pair("cam2=left", "no camera 'cam2'"),
                                     std::pair("cam0=lefd", "did you mean 'left'?"),
                                     std::pair("cam0=left,cam1=left", "stands twice")}) {
    const Outcome wrong = with_map(map);
    EXPECT_EQ(wrong.status, kWrongInput) << map;
    EXPECT_THAT(wrong.err, HasSubstr(message));
  }
}

TEST_F(CompareCommand, ConvertsBetweenModelsAndReadsTheResultAgain) {
  CalibrateHalves();
  const Outcome there = Run({"convert", "a/calibration.yaml", "--to", "pinhole-radtan", "-o", "c"});
  ASSERT_EQ(there.status, kDone) << there.err;
  // pinhole-radial3 is OpenCV's k_1, k_2, k_3, so nothing is lost.
  const Table errors(Read("c/conversion_errors.csv"));
  for (const std::string column : {"dx", "dy"}) {
    for (const double error : errors.Numbers(column)) EXPECT_LT(std::abs(error), 1e-6);
  }
  EXPECT_EQ(Read("c/conversion_errors.png").substr(1, 3), "PNG");
  const YAML::Node was = Result("a")["cameras"].begin()->second["parameters"];
  const YAML::Node is = Result("c")["cameras"].begin()->second["parameters"];
  EXPECT_NEAR(is["k_1"].as<double>(), was["A_0"].as<double>(), 1e-6);
  EXPECT_NEAR(is["k_3"].as<double>(), was["A_2"].as<double>(), 1e-6);

  const Outcome outcome = Run({"compare", "a/calibration.yaml", "c/calibration.yaml"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_THAT(outcome.out, HasSubstr("pinhole-radial3 and pinhole-radtan"));
}

TEST_F(CompareCommand, ConversionsOfNarrowImagesAreDrawn) {
  Write("camera.yaml",
        "plenocal: 1\ncameras:\n  cam:\n    model: pinhole\n    image_size: [4, 4096]\n"
        "    parameters: {f_x: 2000, f_y: 2000, c_x: 2, c_y: 2048}\n"
        "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n");
  const Outcome outcome = Run({"convert", "camera.yaml", "--to", "equidistant", "-o", "c"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
}

TEST_F(CompareCommand, ConversionsToEveryModelCanBeRead) {
  // Double sphere and fov come near it only beyond their parameters' limits.
  Write(
      "camera.yaml",
      "plenocal: 1\ncameras:\n  cam:\n    model: pinhole-radial3\n    image_size: [640, 480]\n"
      "    parameters: {f_x: 400, f_y: 402, c_x: 322, c_y: 236, A_0: -0.2, A_1: 0.06, A_2: -0.01}\n"
      "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n");
  int converted = 0, exact = 0;
  for (const CameraModel& model : CameraModels()) {
    if (!model.IsCentral()) continue;
    ++converted;
    SCOPED_TRACE(model.name);
    const Outcome there =
        Run({"convert", "camera.yaml", "--to", std::string(model.name), "-o", "c"});
    ASSERT_EQ(there.status, kDone) << there.err;
    const Outcome outcome = Run({"compare", "camera.yaml", "c/calibration.yaml", "-o", "d"});
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    if (model.name != "pinhole-radial3" && model.name != "pinhole-radtan") continue;
    ++exact;
    const auto differences = Table(Read("d/compare.csv")).Numbers("largest");
    EXPECT_FALSE(differences.empty());
    for (const double largest : differences) EXPECT_LT(largest, 1e-9);  // the same equations
  }
  EXPECT_GT(converted, 10);
  EXPECT_EQ(exact, 2);
}

TEST_F(CompareCommand, DrawsThePictureAndWritesTheTable) {
  CalibrateHalves();
  const Outcome outcome = Run({"compare", "a/calibration.yaml", "b/calibration.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const Table table(Read("out/compare.csv"));
  EXPECT_EQ(table.Rows(), 2u * 10u);  // two distances, all and nine parts
  EXPECT_THAT(outcome.out, HasSubstr(fmt::format("{:.4f}", table.Numbers("rms")[0])));
  const cv::Mat picture = cv::imread(Path("out/difference.png").string());
  ASSERT_FALSE(picture.empty());
  // Brighter where the difference is larger: the darkest and the brightest colour of the scale.
  int dark = 0, bright = 0;
  for (int y = 0; y < picture.rows; ++y) {
    for (int x = 0; x < picture.cols; ++x) {
      const auto& pixel = picture.at<cv::Vec3b>(y, x);
      dark += pixel[0] > 70 && pixel[1] < 60 && pixel[2] < 90 ? 1 : 0;
      bright += pixel[0] < 60 && pixel[1] > 200 && pixel[2] > 200 ? 1 : 0;
    }
  }
  EXPECT_GT(dark, 1000);
  EXPECT_GT(bright, 10);
}

TEST_F(CompareCommand, ChecksWhetherACalibrationHoldsForNewImages) {
  // Six checks of calibrations that hold, one in a hundred of which may fail; and as many of a
  // camera whose focal length has changed by twenty sigmas.
  int rejected = 0, found = 0;
  constexpr int kChecks = 6;
  for (unsigned seed = 0; seed < kChecks; ++seed) {
    SyntheticProblem problem = MakeProblem(40 + seed, {.cameras = 1, .frames = 16, .noise = 0.1});
    std::vector<View>& views = problem.input.cameras[0].views;
    const std::vector<View> all = views;
    views.assign(all.begin(), all.begin() + 8);
    WriteProblem(problem);
    Calibrate("old");
    views.assign(all.begin() + 8, all.end());
    WriteProblem(problem);
    const Outcome outcome = Run({"compare", "old/calibration.yaml", "--check", "session.yaml"});
    EXPECT_THAT(outcome.status, ::testing::AnyOf(kDone, kJobFailed)) << outcome.err;
    rejected += outcome.status == kJobFailed ? 1 : 0;
    EXPECT_THAT(outcome.out,
                HasSubstr(outcome.status == kDone ? "is still valid" : "is not valid any more"));

    const double sigma = Result("old")["cameras"].begin()->second["sigma"]["f_x"].as<double>();
    Change("old/calibration.yaml", "changed.yaml", "f_x", 20 * sigma);
    const Outcome changed = Run({"compare", "changed.yaml", "--check", "session.yaml", "--json"});
    found += changed.status == kJobFailed ? 1 : 0;
    const auto json = nlohmann::json::parse(changed.out);
    EXPECT_EQ(json["valid"].get<bool>(), changed.status == kDone);
    EXPECT_EQ(json["verdict"]["grade"], changed.status == kDone ? "good" : "bad");
    EXPECT_EQ(json["verdict"]["findings"][0]["code"], "parameters_changed");
    EXPECT_GT(json["cameras"][0]["rms_poses_only"].get<double>(),
              json["cameras"][0]["rms_all_free"].get<double>());
    if (changed.status == kJobFailed) {
      EXPECT_THAT(changed.err,
                  HasSubstr("changed.yaml does not hold for the images of session.yaml"));
    }
  }
  EXPECT_EQ(rejected, 0);
  EXPECT_EQ(found, kChecks);
}

TEST_F(CompareCommand, ChecksThePlacesOnTheRig) {
  const SyntheticProblem problem = MakeProblem(9, {.cameras = 2, .frames = 16, .noise = 0.1});
  WriteProblem(problem);
  Calibrate("old");
  const Outcome same =
      Run({"compare", "old/calibration.yaml", "--check", "session.yaml", "-o", "out"});
  EXPECT_EQ(same.status, kDone) << same.out << same.err;
  for (const char* file : {"check.json", "compare.csv", "difference.png"}) {
    EXPECT_TRUE(std::filesystem::exists(Path("out") / file)) << file;
  }
  // The second camera has been knocked by five millimetres.
  YAML::Node file = YAML::Load(Read("old/calibration.yaml"));
  YAML::Node row = file["cameras"]["cam1"]["T_camera_rig"][0];
  row[3] = row[3].as<double>() + 0.005;
  Write("knocked.yaml", YAML::Dump(file) + "\n");
  const Outcome knocked = Run({"compare", "knocked.yaml", "--check", "session.yaml", "--json"});
  EXPECT_EQ(knocked.status, kJobFailed);
  const auto cameras = nlohmann::json::parse(knocked.out)["cameras"];
  EXPECT_TRUE(cameras[0]["valid"].get<bool>());
  EXPECT_FALSE(cameras[1]["valid"].get<bool>());
  EXPECT_NEAR(cameras[1]["mount_shift"].get<double>(), 0.005, 0.001);
  EXPECT_EQ(nlohmann::json::parse(knocked.out)["verdict"]["findings"][0]["code"], "mount_changed");
}

TEST_F(CompareCommand, RefusesWhatItCannotReadOrCompare) {
  CalibrateHalves();
  const auto fails = [&](const std::vector<std::string>& arguments, const std::string& part) {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kWrongInput) << outcome.err;
    EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_EQ(Lines(outcome.err).size(), 1);
  };
  fails({"compare", "a/calibration.yaml", "absent.yaml"}, "absent.yaml");
  fails({"compare", "a/calibration.yaml", "session.yaml"}, "session.yaml");
  fails({"compare", "a/calibration.yaml", "b/calibration.yaml", "--distance", "-1"}, "--distance");
  fails({"compare", "a/calibration.yaml"}, "--check");
  fails({"compare", "a/calibration.yaml", "b/calibration.yaml", "--json"}, "--check");
  fails({"compare", "a/calibration.yaml", "b/calibration.yaml", "--check", "session.yaml"},
        "either");
  Write("small.yaml", Replaced(Read("a/calibration.yaml"), "[1280, 960]", "[640, 480]"));
  fails({"compare", "small.yaml", "--check", "session.yaml", "--quiet"}, "640 x 480");
  fails({"convert", "a/calibration.yaml", "--to", "pinhole-radtn", "-o", "x"},
        "did you mean 'pinhole-radtan'?");
  fails({"convert", "a/calibration.yaml", "--to", "focused-plenoptic", "-o", "x"},
        "no model of an ordinary camera");
  fails({"convert", "a/calibration.yaml", "--camera", "nobody", "--to", "ucm", "-o", "x"},
        "no camera 'nobody'");
  Write("broken.yaml",
        Replaced(Read("a/calibration.yaml"), "T_camera_rig: [[", "T_camera_rig: [[7"));
  fails({"compare", "broken.yaml", "b/calibration.yaml"}, "broken.yaml:");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
