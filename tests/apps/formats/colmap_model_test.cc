// SPDX-License-Identifier: Apache-2.0
//
// `plenocal import --format colmap-model`: models of simulated tracks, as text and binary.
#include <fmt/format.h>

#include <Eigen/Geometry>
#include <array>
#include <cstdint>
#include <filesystem>
#include <map>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr std::uint64_t kNoPoint = ~std::uint64_t{0};

struct Seen {
  double x, y;
  std::uint64_t point;
};

struct Image {
  std::string name;
  int camera;
  std::vector<Seen> seen;
};

template <typename Number>
std::string Bytes(Number number) {
  return {reinterpret_cast<const char*>(&number), sizeof(number)};
}

class ColmapModel : public Workspace {
 protected:
  // Both cameras of the simulated pair, images left/00.png, right/00.png, ... with a feature that
  // no point has.
  void Simulate() {
    fs::copy_file(fs::path(PLENOCAL_EXAMPLES) / "simulate" / "scene_free.yaml", Path("spec.yaml"));
    Write("spec.yaml", Replaced(Read("spec.yaml"), "frames: 40", "frames: 24"));
    const Outcome simulated = Run({"simulate", "spec.yaml", "--points", "-o", "truth"});
    ASSERT_EQ(simulated.status, kDone) << simulated.err;
    int camera = 3;
    for (const char* name : {"left", "right"}) {
      const Table tracks(Read(fmt::format("truth/tracks_{}.csv", name)));
      const auto frames = tracks.Column("frame");
      const auto points = tracks.Numbers("marker"), x = tracks.Numbers("x"),
                 y = tracks.Numbers("y");
      std::map<std::string, Image> of_camera;
      for (size_t i = 0; i < tracks.Rows(); ++i) {
        Image& image =
            of_camera
                .try_emplace(
                    frames[i],
                    Image{fmt::format("{}/{}.png", name, frames[i]), camera, {{10, 10, kNoPoint}}})
                .first->second;
        image.seen.push_back({x[i] + 0.5, y[i] + 0.5, static_cast<std::uint64_t>(points[i])});
      }
      for (auto& [frame, image] : of_camera) images_.push_back(std::move(image));
      camera += 4;
    }
  }
  void WriteText() const {
    fs::create_directories(Path("text"));
    Write("text/cameras.txt",
          "# comment\n3 SIMPLE_RADIAL 640 512 400 320 256 0\n7 SIMPLE_RADIAL 640 512 400 320 256 "
          "0\n9 PINHOLE 640 512 400 400 320 256\n");
    std::string text = "# comment\n";
    for (size_t i = 0; i < images_.size(); ++i) {
      text += fmt::format("{} 1 0 0 0 0 0 0 {} {}\n", i, images_[i].camera, images_[i].name);
      for (const Seen& seen : images_[i].seen) {
        text += fmt::format("{} {} {} ",
                            seen.x,
                            seen.y,
                            seen.point == kNoPoint ? "-1" : std::to_string(seen.point));
      }
      text += "\n";
    }
    Write("text/images.txt", text);
  }
  void WriteBinary() const {
    fs::create_directories(Path("binary"));
    std::string cameras = Bytes(std::uint64_t{2});
    for (const std::uint32_t id : {3U, 7U}) {
      cameras += Bytes(id) + Bytes(std::uint32_t{2}) + Bytes(std::uint64_t{640}) +
                 Bytes(std::uint64_t{512});
      for (const double value : {400.0, 320.0, 256.0, 0.0}) cameras += Bytes(value);
    }
    Write("binary/cameras.bin", cameras);
    std::string text = Bytes(std::uint64_t{images_.size()});
    for (size_t i = 0; i < images_.size(); ++i) {
      text += Bytes(static_cast<std::uint32_t>(i));
      for (const double value : {1, 0, 0, 0, 0, 0, 0}) text += Bytes(value);
      text += Bytes(images_[i].camera) + images_[i].name + std::string(1, '\0') +
              Bytes(std::uint64_t{images_[i].seen.size()});
      for (const Seen& seen : images_[i].seen) {
        text += Bytes(seen.x) + Bytes(seen.y) + Bytes(seen.point);
      }
    }
    Write("binary/images.bin", text);
  }
  [[nodiscard]] Outcome Import(const std::string& model) const {
    return Run({"import", model, "--format", "colmap-model", "-o", "in_" + model});
  }
  void ExpectRefusal(const std::string& part) const {
    const Outcome outcome = Import("text");
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_THAT(outcome.err, HasSubstr(part));
    EXPECT_FALSE(fs::exists(Path("in_text")));
  }

  // Of "out", whose COLMAP model is in "model".
  void ExpectPosesOfColmapInAliceVision() const {
    const Outcome outcome =
        Run({"export", "out/calibration.yaml", "--format", "alicevision", "-o", "sfm"});
    ASSERT_EQ(outcome.status, kDone) << outcome.err;
    const YAML::Node sfm = YAML::Load(Read("sfm/cameras.sfm"));
    std::map<std::string, size_t> places;
    for (size_t i = 0; i < sfm["views"].size(); ++i) {
      places[sfm["views"][i]["path"].as<std::string>()] = i;
    }
    size_t compared = 0;
    for (const std::string& line : Lines(Read("model/images.txt"))) {
      std::istringstream words(line);
      double id = 0, w = 0, x = 0, y = 0, z = 0;
      Eigen::Vector3d t;
      std::string camera, name;
      if (!(words >> id >> w >> x >> y >> z >> t[0] >> t[1] >> t[2] >> camera >> name)) continue;
      const auto place = places.find(name);
      if (place == places.end()) continue;  // a line of points
      const YAML::Node pose = sfm["poses"][place->second]["pose"]["transform"];
      Eigen::Matrix3d R;
      Eigen::Vector3d centre;
      for (int i = 0; i < 9; ++i) R(i % 3, i / 3) = pose["rotation"][i].as<double>();
      for (int i = 0; i < 3; ++i) centre[i] = pose["center"][i].as<double>();
      constexpr double kRounding = 1e-12;
      EXPECT_LT((R - Eigen::Quaterniond(w, x, y, z).matrix()).norm(), kRounding);
      EXPECT_LT((R * centre + t).norm(), kRounding);
      const YAML::Node view = sfm["views"][place->second];
      EXPECT_EQ(view["poseId"].as<std::string>(),
                sfm["poses"][place->second]["poseId"].as<std::string>());
      EXPECT_LT(view["intrinsicId"].as<size_t>(), sfm["intrinsics"].size());
      ++compared;
    }
    EXPECT_EQ(compared, places.size());
    EXPECT_GT(compared, 3U);
    // As many in the files of nerfstudio, one a camera.
    const Outcome nerf =
        Run({"export", "out/calibration.yaml", "--format", "nerfstudio", "-o", "transforms.json"});
    ASSERT_EQ(nerf.status, kDone) << nerf.err;
    size_t frames = 0;
    for (const char* camera : {"left", "right"}) {
      frames += YAML::Load(Read(std::string("transforms_") + camera + ".json"))["frames"].size();
    }
    EXPECT_EQ(frames, compared);
  }

  std::vector<Image> images_;
};

TEST_F(ColmapModel, OfAPairIsCalibratedToItsSimulatedParameters) {
  Simulate();
  WriteText();
  WriteBinary();
  for (const char* model : {"text", "binary"}) {
    const Outcome imported = Import(model);
    ASSERT_EQ(imported.status, kDone) << imported.err;
  }
  EXPECT_EQ(Files("in_text"), Files("in_binary"));
  const Outcome outcome = Run({"calibrate", "in_text/session.yaml", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  const YAML::Node truth = YAML::LoadFile(Path("truth/truth/calibration.yaml"));
  for (const char* camera : {"left", "right"}) {
    for (const auto& param : truth["cameras"][camera]["parameters"]) {
      const auto name = param.first.as<std::string>();
      const YAML::Node found = Result()["cameras"][camera];
      EXPECT_NEAR(found["parameters"][name].as<double>(),
                  param.second.as<double>(),
                  4 * found["sigma"][name].as<double>())
          << camera << " " << name;
    }
  }
}

// What was used goes out as a model and comes back; the report is drawn from the files alone.
TEST_F(ColmapModel, OfACalibrationHoldsItsUsedPoints) {
  Simulate();
  WriteText();
  ASSERT_EQ(Import("text").status, kDone);
  const Outcome calibrated = Run({"calibrate", "in_text/session.yaml", "-o", "out"});
  ASSERT_EQ(calibrated.status, kDone) << calibrated.err;
  const Outcome exported =
      Run({"export", "out/calibration.yaml", "--format", "colmap", "-o", "model"});
  ASSERT_EQ(exported.status, kDone) << exported.err;
  ASSERT_EQ(Import("model").status, kDone);
  const Table residuals(Read("out/residuals.csv"));
  for (const std::string camera : {"left", "right"}) {
    std::map<std::pair<std::string, std::string>, std::pair<double, double>> expected, found;
    const auto cameras = residuals.Column("camera"), frames = residuals.Column("frame"),
               markers = residuals.Column("marker"), used = residuals.Column("used");
    const auto x = residuals.Numbers("x"), y = residuals.Numbers("y");
    for (size_t i = 0; i < residuals.Rows(); ++i) {
      if (cameras[i] == camera && used[i] == "1") expected[{frames[i], markers[i]}] = {x[i], y[i]};
    }
    const Table again(Read("in_model/detections_" + camera + ".csv"));
    const auto names = again.Column("frame"), numbers = again.Column("marker");
    const auto u = again.Numbers("x"), v = again.Numbers("y");
    for (size_t i = 0; i < again.Rows(); ++i) found[{names[i], numbers[i]}] = {u[i], v[i]};
    ASSERT_EQ(found.size(), expected.size());
    for (const auto& [key, pixel] : expected) {
      EXPECT_NEAR(found.at(key).first, pixel.first, 1e-9);
      EXPECT_NEAR(found.at(key).second, pixel.second, 1e-9);
    }
  }
  ExpectPosesOfColmapInAliceVision();
  const std::string report = Read("out/report.html");
  EXPECT_EQ(Run({"report", "out"}).status, kDone);
  EXPECT_EQ(Read("out/report.html"), report);
  fs::remove(Path("out/poses.csv"));
  const Outcome refused =
      Run({"export", "out/calibration.yaml", "--format", "colmap", "-o", "another"});
  EXPECT_EQ(refused.status, kWrongInput);
  EXPECT_THAT(refused.err, HasSubstr("has no poses.csv"));
}

TEST_F(ColmapModel, WithoutFoldersNamesItsCamerasByTheirNumbers) {
  images_ = {{"a.png", 3, {{1, 2, 5}, {3, 4, 6}, {5, 6, 6}}}, {"b.png", 7, {{1, 2, 5}}}};
  WriteText();
  const Outcome outcome = Import("text");
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  // A point with two features in one image has none.
  EXPECT_EQ(Read("in_text/detections_camera3.csv"), "frame,marker,x,y\na,5,0.5,1.5\n");
  EXPECT_EQ(Read("in_text/detections_camera7.csv"), "frame,marker,x,y\nb,5,0.5,1.5\n");
}

TEST_F(ColmapModel, ThatIsBrokenIsRefusedWithFileAndPlace) {
  images_ = {{"left/a.png", 3, {{1, 2, 5}}}, {"left/b.png", 3, {}}};
  WriteText();
  const std::string good = Read("text/images.txt");
  EXPECT_EQ(Import("text").status, kDone);
  fs::remove_all(Path("in_text"));
  for (const auto& [from, to, message] :
       std::vector<std::array<std::string, 3>>{{"1 2 5", "1 2", "images.txt:3: expected 'X Y"},
                                               {"1 2 5", "1 nan 5", "images.txt:3: expected a num"},
                                               {"1 2 5", "1 2 5e3", "images.txt:3: expected a who"},
                                               {"1 2 5", "1 2 5000000000", "above 2147483647"},
                                               {"1 2 5", "1 2 -1", "no points"},
                                               {"left/b", "right/../a", "images.txt:4"},
                                               {"0 3 left/a", "0 4 left/a", "lacks cameras"}}) {
    Write("text/images.txt", Replaced(good, from, to));
    ExpectRefusal(message);
  }
  Write("text/images.txt", good);
  fs::rename(Path("text/cameras.txt"), Path("text/other"));
  ExpectRefusal("text/cameras.txt");
  fs::rename(Path("text/other"), Path("text/cameras.txt"));
  WriteBinary();
  const std::string binary = Read("binary/images.bin");
  for (size_t size = 0; size < binary.size(); size += 7) {
    Write("text/images.bin", binary.substr(0, size));
    ExpectRefusal("images.bin: is cut short");
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
