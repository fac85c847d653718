// SPDX-License-Identifier: Apache-2.0
//
// The keys of a simulation's specification: limits, words, defaults and refusals.
#include "apps/simulate/spec/simulation_spec.h"

#include <fmt/format.h>

#include <numbers>

#include "calib/base/error.h"
#include "models/registry.h"
#include "tests/apps/workspace.h"

namespace plenocal::simulate {
namespace TEST_FILE {

using ::plenocal::testing::Workspace;
using ::testing::ElementsAre;

// Texts in place of the words between @ of a template.
using Texts = std::map<std::string, std::string>;

constexpr const char* kCameras =
    "cameras:\n"
    "  left:\n"
    "    model: pinhole-radial3\n"
    "    image_size: @size@\n"
    "    parameters: {f_x: 60, f_y: 61, c_x: 31, c_y: 24@parameters@}\n"
    "@left@\n"
    "  raw:\n"
    "    model: @raw_model@\n"
    "    image_size: [90, 80]\n"
    "    pixel_size: 7.4e-6\n"
    "    parameters: {f_L: 0.0122, b_L0: 0.01166, B: 0.00026, c_x: 45, c_y: 40}\n"
    "    micro_lenses: {@lenses@}\n"
    "@raw@\n";
const std::string kTargetSpec =
    std::string("plenocal: 1\n@target@\n@root@\nposes: {@poses@}\n") + kCameras;
const std::string kSceneSpec = std::string(
                                   "plenocal: 1\nscene: {@scene@}\ntrajectory: {@trajectory@}\n"
                                   "calibration_sigma: {@sigma@}\n@root@\n") +
                               kCameras;

std::string Filled(std::string text, Texts texts) {
  texts.insert({{"target", "target: board.yaml"},
                {"root", ""},
                {"poses", "frames: 4, distance: [0.4, 0.8]"},
                {"size", "[64, 48]"},
                {"parameters", ""},
                {"left", "    bits: 8"},
                {"lenses", "pitch: 10, focus: [2]"},
                {"raw", "    bits: 8"},
                {"raw_model", "focused-plenoptic"},
                {"scene", ""},
                {"trajectory", ""},
                {"sigma", ""}});
  for (const auto& [word, with] : texts) {
    const std::string place = "@" + word + "@";
    for (size_t at = text.find(place); at != std::string::npos; at = text.find(place)) {
      text.replace(at, place.size(), with);
    }
  }
  return text;
}

class SimulationSpecFile : public Workspace {
 protected:
  SimulationSpec ReadText(const std::string& text) const {
    Write("spec.yaml", text);
    return ReadSimulationSpec(Path("spec.yaml"), CameraModels());
  }
  SimulationSpec ReadTarget(const Texts& texts = {}) const {
    return ReadText(Filled(kTargetSpec, texts));
  }
  SimulationSpec ReadScene(const Texts& texts = {}) const {
    return ReadText(Filled(kSceneSpec, texts));
  }
  // The message without the folder; "read" where the text is read.
  std::string Message(const std::string& text) const {
    try {
      ReadText(text);
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      std::string message = error.what();
      const std::string folder = Path("").string();
      for (size_t at = message.find(folder); at != std::string::npos; at = message.find(folder)) {
        message.erase(at, folder.size());
      }
      return message;
    }
    return "read";
  }
  std::string Target(const Texts& texts) const { return Message(Filled(kTargetSpec, texts)); }
  std::string Scene(const Texts& texts) const { return Message(Filled(kSceneSpec, texts)); }

  // A number with limits: `texts` has the key with "#" in place of its value.
  struct Limit {
    Texts texts;
    double low, high;
    std::function<double(const SimulationSpec&)> value;
    bool is_integer = false;
  };
  void ExpectLimits(const std::string& whole, const std::vector<Limit>& limits) const {
    for (const Limit& limit : limits) {
      const auto with = [&](double value) {
        Texts texts = limit.texts;
        for (auto& [place, text] : texts) {
          const size_t at = text.find('#');
          if (at != std::string::npos) {
            text.replace(
                at, 1, limit.is_integer ? fmt::format("{:.0f}", value) : fmt::format("{}", value));
          }
        }
        return Filled(whole, texts);
      };
      SCOPED_TRACE(with(limit.low));
      for (const double value : {limit.low, limit.high}) {
        EXPECT_EQ(limit.value(ReadText(with(value))), value);
      }
      const auto step = [&](double x) {
        return limit.is_integer ? 1 : x == 0 ? 0.1 : std::abs(x) / 8;
      };
      for (const double value : {limit.low - step(limit.low), limit.high + step(limit.high)}) {
        EXPECT_THAT(
            Message(with(value)),
            ::testing::HasSubstr(
                limit.is_integer
                    ? fmt::format(
                          "expected {:.0f} to {:.0f}, found {:.0f}", limit.low, limit.high, value)
                    : fmt::format("expected a number from {} to {}, found {}",
                                  limit.low,
                                  limit.high,
                                  value)));
      }
    }
  }
};

TEST_F(SimulationSpecFile, HasTheLimitsOfATargetsNumbers) {
  constexpr double kPi = std::numbers::pi;
  const auto pose = [](const std::string& key, auto member) {
    return std::pair{Texts{{"poses", "frames: 4, distance: [0.4, 0.8], " + key}},
                     [member](const SimulationSpec& s) -> double { return s.poses.*member; }};
  };
  const auto left = [](const std::string& key, auto get) {
    return std::pair{
        Texts{{"left", "    " + key}, {"poses", "frames: 4, distance: [1, 2], kind: moving"}},
        [get](const SimulationSpec& s) -> double { return get(s.cameras[0]); }};
  };
  const auto lenses = [](const std::string& key, auto member) {
    return std::pair{Texts{{"lenses", "focus: [2], " + key}},
                     [member](const SimulationSpec& s) -> double {
                       return (*s.cameras[1].micro_lenses).*member;
                     }};
  };
  const auto root = [](const std::string& key, auto get) {
    return std::pair{Texts{{"root", key}},
                     [get](const SimulationSpec& s) -> double { return get(s); }};
  };
  std::vector<Limit> limits;
  const auto add = [&](const auto& place, double low, double high, bool is_integer = false) {
    limits.push_back({place.first, low, high, place.second, is_integer});
  };
  add(root("target_error: #", [](const auto& s) { return *s.target_error; }), 0, 1);
  add(root("white_images: #", [](const auto& s) { return s.white_images; }), 1, 1000, true);
  limits.push_back({{{"poses", "frames: #, distance: [0.4, 0.8]"}},
                    1,
                    100000,
                    [](const SimulationSpec& s) -> double { return s.poses.frames; },
                    true});
  add(pose("kind: moving, rate: #", &PoseSpec::rate), 0.1, 1e5);
  add(pose("tilt: #", &PoseSpec::tilt), 0, 1.4);
  add(pose("roll: #", &PoseSpec::roll), 0, kPi);
  add(pose("partial: #", &PoseSpec::partial), 0, 1);
  add(left("full_well: #", [](const auto& c) { return c.sensor.full_well; }), 10, 1e9);
  add(left("read_noise: #", [](const auto& c) { return c.sensor.read_noise; }), 0, 1e6);
  add(left("exposure: #", [](const auto& c) { return c.sensor.exposure; }), 0.01, 1);
  add(left("blur: #", [](const auto& c) { return c.sensor.blur; }), 0, 20);
  add(left("detection_sigma: #", [](const auto& c) { return c.detection_sigma; }), 0, 1e6);
  add(left("time_offset: #", [](const auto& c) { return c.time_offset; }), -10, 10);
  add(left("time_shift: #", [](const auto& c) { return c.time_shift; }), -10, 10);
  add(left("vignetting: #", [](const auto& c) { return -c.sensor.vignetting.polynomial[0]; }),
      0,
      0.95);
  add(lenses("pitch: #", &MicroLensSpec::pitch), 6, 500);
  add(lenses("pitch: 10, lattice: rectangular, row_pitch: #", &MicroLensSpec::row_pitch), 6, 500);
  add(lenses("pitch: 10, rotation: #", &MicroLensSpec::rotation), -2 * kPi, 2 * kPi);
  add(lenses("pitch: 10, aperture: #", &MicroLensSpec::aperture), 0.01, 1);
  add(lenses("pitch: 10, fill: #", &MicroLensSpec::fill), 0.1, 1.5);
  add(lenses("pitch: 10, gain_sigma: #", &MicroLensSpec::gain_sigma), 0, 0.2);
  add(lenses("pitch: 10, dull: #", &MicroLensSpec::dull), 0, 1000, true);
  ExpectLimits(kTargetSpec, limits);
}

TEST_F(SimulationSpecFile, HasTheLimitsOfWallsAndExposures) {
  const auto wall = [](const std::string& key, auto member) {
    return std::pair{Texts{{"root", "wall: {" + key + "}"}},
                     [member](const SimulationSpec& s) -> double { return (*s.wall).*member; }};
  };
  const auto exposures = [](const std::string& key, auto member) {
    return std::pair{
        Texts{{"root", "exposures: {range: [1, 2], " + key + "}"}},
        [member](const SimulationSpec& s) -> double { return (*s.exposures).*member; }};
  };
  const auto root = [](const std::string& key, auto get) {
    return std::pair{Texts{{"root", key}},
                     [get](const SimulationSpec& s) -> double { return get(s); }};
  };
  std::vector<Limit> limits;
  const auto add = [&](const auto& place, double low, double high) {
    limits.push_back({place.first, low, high, place.second, false});
  };
  add(wall("contrast: #", &WallSpec::contrast), 0, 0.5);
  add(wall("structure: #", &WallSpec::structure), 1e-6, 10);
  add(wall("light: #", &WallSpec::light), 0, 0.9);
  add(wall("gloss: #", &WallSpec::gloss), 0, 1);
  add(wall("shading: #", &WallSpec::shading), -0.5, 0.5);
  add(wall("fold_angle: #", &WallSpec::fold_angle), -1, 1);
  add(root("wall: {fold: #}", [](const auto& s) { return *s.wall->fold; }), -100, 100);
  add(exposures("nominal: #", &ExposureSpec::nominal), 1e-6, 1e6);
  add(exposures("error: #", &ExposureSpec::error), 0, 0.5);
  add(exposures("late: {camera: raw, change: #}", &ExposureSpec::late_change), -0.9, 10);
  add(exposures("late: {camera: raw, share: #}", &ExposureSpec::late_share), 0, 1);
  ExpectLimits(kTargetSpec, limits);
  EXPECT_EQ(ReadTarget({{"root", "seed: 2147483647"}}).seed, 2147483647);
  EXPECT_EQ(ReadTarget({{"root", "seed: 0"}}).seed, 0);
  EXPECT_EQ(Target({{"root", "seed: -1"}}),
            "spec.yaml:3:7: seed: expected 0 to 2147483647, found -1");
}

TEST_F(SimulationSpecFile, HasTheLimitsOfAScenesNumbers) {
  constexpr double kPi = std::numbers::pi;
  std::vector<Limit> limits;
  const auto scene =
      [&](const std::string& key, auto get, double low, double high, bool is_integer = false) {
        limits.push_back(
            {{{"scene", key}},
             low,
             high,
             [get](const SimulationSpec& s) -> double { return get(s.scenery->scene); },
             is_integer});
      };
  const auto path =
      [&](const std::string& key, auto get, double low, double high, bool is_integer = false) {
        limits.push_back(
            {{{"trajectory", key}},
             low,
             high,
             [get](const SimulationSpec& s) -> double { return get(s.scenery->trajectory); },
             is_integer});
      };
  const auto sigma = [&](const std::string& key, auto get, double low, double high) {
    limits.push_back({{{"sigma", key}}, low, high, [get](const SimulationSpec& s) -> double {
                        return get(s.scenery->calibration_sigma);
                      }});
  };
  scene(
      "points: #", [](const auto& s) { return s.points; }, 1, 1e7, true);
  scene(
      "boxes: #", [](const auto& s) { return *s.boxes; }, 0, 100000, true);
  scene(
      "moving: #", [](const auto& s) { return s.moving; }, 0, 0.9);
  scene(
      "track_length: #", [](const auto& s) { return s.track_length; }, 1, 1e9);
  scene(
      "wrong_matches: #", [](const auto& s) { return s.wrong_matches; }, 0, 0.9);
  scene(
      "merged: #", [](const auto& s) { return s.merged; }, 0, 1);
  scene(
      "distances: #", [](const auto& s) { return s.distances; }, 0, 1000, true);
  scene(
      "distance_sigma: #", [](const auto& s) { return s.distance_sigma; }, 1e-9, 10);
  path(
      "segment: 0.01, speed: 0.01, length: #", [](const auto& t) { return t.length; }, 1, 1e5);
  path(
      "segment: 0.01, speed: #", [](const auto& t) { return t.speed; }, 0.01, 100);
  path(
      "rate: #", [](const auto& t) { return t.rate; }, 0.1, 10000);
  path(
      "kind: handheld, frames: 9, segment: #", [](const auto& t) { return t.segment; }, 0.01, 1e5);
  path(
      "overlap: #", [](const auto& t) { return t.overlap; }, 0, 1);
  path(
      "shake: #", [](const auto& t) { return t.shake; }, 0, 10);
  path(
      "turn: #", [](const auto& t) { return t.turn; }, 0, kPi);
  path(
      "roll: #", [](const auto& t) { return t.roll; }, 0, kPi);
  path(
      "frames: #", [](const auto& t) { return *t.frames; }, 2, 1e6, true);
  path(
      "winding: {amplitude: #}", [](const auto& t) { return *t.amplitude; }, 0, 100);
  path(
      "winding: {seconds: #}", [](const auto& t) { return t.seconds; }, 0.1, 1e4);
  sigma(
      "baseline: #", [](const auto& s) { return s.baseline; }, 0, 1);
  sigma(
      "rotation: #", [](const auto& s) { return s.rotation; }, 0, 1);
  sigma(
      "focal: #", [](const auto& s) { return s.focal; }, 0, 1000);
  sigma(
      "parameters: {left: {f_x: #}}",
      [](const auto& s) { return s.parameters.at("left").at("f_x"); },
      0,
      1e12);
  ExpectLimits(kSceneSpec, limits);
  EXPECT_EQ(ReadScene({{"scene", "near: 0.001, far: 1e5"}}).scenery->scene.nearest, 1e-3);
  EXPECT_EQ(ReadScene({{"scene", "near: 0.001, far: 1e5"}}).scenery->scene.farthest, 1e5);
  EXPECT_EQ(Scene({{"scene", "near: 0.0009"}}),
            "spec.yaml:2:15: scene.near: expected a number from 0.001 to 100000, found 0.0009");
  EXPECT_EQ(Scene({{"scene", "far: 0.0009"}}),
            "spec.yaml:2:14: scene.far: expected a number from 0.001 to 100000, found 0.0009");
  EXPECT_EQ(Scene({{"scene", "near: 110000"}}),
            "spec.yaml:2:15: scene.near: expected a number from 0.001 to 100000, found 110000");
  EXPECT_EQ(Scene({{"scene", "far: 110000"}}),
            "spec.yaml:2:14: scene.far: expected a number from 0.001 to 100000, found 110000");
}

TEST_F(SimulationSpecFile, HasTheDefaultsOfTheDocuments) {
  const SimulationSpec target = ReadTarget();
  EXPECT_EQ(target.path, Path("spec.yaml"));
  EXPECT_EQ(target.seed, 1);
  EXPECT_FALSE(target.target_error || target.wall || target.exposures || target.scenery);
  EXPECT_TRUE(target.rigid_tags);
  EXPECT_EQ(target.white_images, 5);
  ASSERT_EQ(target.targets.size(), 1u);
  EXPECT_EQ(target.targets[0].name, "");
  EXPECT_EQ(target.targets[0].file, Path("board.yaml"));
  EXPECT_EQ(target.poses.nearest, 0.4);
  EXPECT_EQ(target.poses.farthest, 0.8);
  EXPECT_EQ(target.poses.frames, 4);
  EXPECT_EQ(target.poses.aim, 0u);
  EXPECT_FALSE(target.poses.aim_all);
  ASSERT_EQ(target.cameras.size(), 2u);
  const CameraSpec &left = target.cameras[0], &raw = target.cameras[1];
  EXPECT_EQ(left.name, "left");
  EXPECT_FALSE(left.IsPlenoptic() || left.micro_lenses || left.sensor.response ||
               left.sensor.bayer);
  EXPECT_EQ(left.image_size, (ImageSize{64, 48}));
  EXPECT_THAT(left.params, ElementsAre(60, 61, 31, 24, 0, 0, 0));
  EXPECT_EQ(left.sensor.vignetting.polynomial[0], -0.2);
  EXPECT_THAT(raw.config, ElementsAre(7.4e-6));
  EXPECT_TRUE(raw.IsPlenoptic());
  EXPECT_EQ(raw.micro_lenses->row_pitch, 10);
  EXPECT_EQ(raw.micro_lenses->lattice, LatticeKind::kHexagonal);
  EXPECT_FALSE(raw.micro_lenses->regular_in_raw);
  EXPECT_EQ(raw.micro_lenses->pattern, Eigen::MatrixXi::Zero(1, 1));
  EXPECT_TRUE(raw.T_camera_rig.R.isIdentity() && raw.T_camera_rig.t.isZero());

  const SimulationSpec wall = ReadTarget({{"root", "wall: {}\nexposures: {range: [2, 8]}"}});
  EXPECT_FALSE(wall.wall->fold);
  EXPECT_EQ(wall.exposures->least, 2);
  EXPECT_EQ(wall.exposures->largest, 8);
  EXPECT_EQ(wall.exposures->nominal, 8);
  EXPECT_FALSE(wall.exposures->sweep);
  EXPECT_TRUE(wall.exposures->known);
  EXPECT_EQ(wall.exposures->late_camera, "");

  const ScenerySpec scene = *ReadScene().scenery;
  EXPECT_EQ(scene.scene.nearest, 2);
  EXPECT_EQ(scene.scene.farthest, 6);
  EXPECT_FALSE(scene.scene.boxes || scene.trajectory.frames || scene.trajectory.amplitude);
  EXPECT_EQ(scene.trajectory.shape, TrajectorySpec::Shape::kLoop);
  EXPECT_THAT(scene.calibration_sigma.parameters, ::testing::IsEmpty());
}

TEST_F(SimulationSpecFile, SetsTheFlagsOfItsWords) {
  const auto poses = [&](const std::string& kind) {
    const PoseSpec p = ReadTarget({{"poses", "frames: 4, distance: [1, 1], kind: " + kind}}).poses;
    return fmt::format(
        "{:d}{:d}{:d}{:d}{:d}", p.one_distance, p.no_tilt, p.corner, p.still, p.moving);
  };
  EXPECT_EQ(poses("varied"), "00000");
  EXPECT_EQ(poses("one-distance"), "10000");
  EXPECT_EQ(poses("no-tilt"), "01000");
  EXPECT_EQ(poses("[corner]"), "00100");
  EXPECT_EQ(poses("[still, one-distance]"), "10010");
  EXPECT_EQ(poses("[varied, moving]"), "00001");
  const auto path = [&](const std::string& text) {
    const ScenerySpec spec = *ReadScene({{"trajectory", text}}).scenery;
    const TrajectorySpec& t = spec.trajectory;
    return fmt::format("{} {:d}{:d}{:d}{:d}{:d}{:d} {} {}",
                       static_cast<int>(t.shape),
                       t.straight,
                       t.rotation,
                       t.no_turning,
                       t.one_depth,
                       t.no_overlap,
                       t.repeated,
                       spec.scene.nearest,
                       spec.scene.farthest);
  };
  EXPECT_EQ(path("kind: loop"), "0 000000 2 6");
  EXPECT_EQ(path("kind: [straight, no-overlap]"), "0 100010 2 6");
  EXPECT_EQ(path("kind: [loop, rotation]"), "0 010000 2 6");
  EXPECT_EQ(path("kind: repeated"), "0 000001 2 6");
  EXPECT_EQ(path("kind: far"), "0 000000 25 80");
  EXPECT_EQ(path("kind: handheld, frames: 3"), "1 000000 2 6");
  EXPECT_EQ(path("kind: [handheld, no-turning, far], frames: 3"), "1 001000 25 80");
  EXPECT_EQ(path("kind: [handheld, rotation], frames: 3"), "1 010000 2 6");
  const ScenerySpec flat =
      *ReadScene({{"scene", "near: 2, far: 8"}, {"trajectory", "kind: one-depth"}}).scenery;
  EXPECT_TRUE(flat.trajectory.one_depth);
  EXPECT_DOUBLE_EQ(flat.scene.nearest, 0.95 * 4);  // the depth is the geometric mean
  EXPECT_DOUBLE_EQ(flat.scene.farthest, 1.05 * 4);
  EXPECT_EQ(flat.scene.boxes, 0);
  EXPECT_TRUE(ReadScene({{"trajectory", "whole: true"}}).scenery->trajectory.whole);
}

TEST_F(SimulationSpecFile, ReadsTheOtherKeysOfCameras) {
  const CameraSpec camera =
      ReadTarget({{"size", "[16, 20000]"},
                  {"parameters", ", A_0: -0.1, A_1: 0.2, A_2: 0.3"},
                  {"left",
                   "    bits: 8\n    bayer: GRBG\n    response: {gamma: 2}\n"
                   "    vignetting: {polynomial: [-0.3, 0.1], centre: [30, 20], axes: [1, 0.5]}"}})
          .cameras[0];
  EXPECT_EQ(camera.image_size, (ImageSize{16, 20000}));
  EXPECT_THAT(camera.params, ElementsAre(60, 61, 31, 24, -0.1, 0.2, 0.3));
  EXPECT_EQ(BayerName(*camera.sensor.bayer), "GRBG");
  EXPECT_THAT(camera.sensor.vignetting.polynomial, ElementsAre(-0.3, 0.1, 0));
  EXPECT_EQ(*camera.sensor.vignetting.centre, Eigen::Vector2d(30, 20));
  EXPECT_EQ(camera.sensor.vignetting.axes, Eigen::Vector2d(1, 0.5));
  const ToneSpec& tone = *camera.sensor.response;
  for (const size_t k : {0, 1, 100, 254}) {
    EXPECT_NEAR(tone.curve.Light(k), static_cast<double>(k * k) / 255, 1e-12);
    EXPECT_NEAR(tone.borders[k], std::pow(static_cast<double>(k) + 0.5, 2) / 255, 1e-12);
  }
  EXPECT_EQ(tone.curve.Light(255), 255);
  for (const char* bits : {"8", "10", "12", "14", "16"}) {
    EXPECT_EQ(std::to_string(
                  ReadTarget({{"left", std::string("    bits: ") + bits}}).cameras[0].sensor.bits),
              bits);
  }
  for (const double gamma : {0.2, 5.0}) {
    const auto read = ReadTarget({{"left", fmt::format("    response: {{gamma: {}}}", gamma)}});
    EXPECT_NEAR(read.cameras[0].sensor.response->curve.Light(51), 255 * std::pow(0.2, gamma), 1e-9);
  }
  ResponseCurve::Table table;
  for (size_t k = 0; k < table.size(); ++k)
    table[k] = std::pow(static_cast<double>(k) / 255, 1.5) * 255;
  Write("pcalib.txt", PcalibText(ResponseCurve(table)));
  const auto file = ReadTarget({{"left", "    response: {file: pcalib.txt}"}});
  EXPECT_NEAR(file.cameras[0].sensor.response->curve.Light(100), table[100], 1e-6);
  EXPECT_NEAR(
      file.cameras[0].sensor.response->borders[100], 255 * std::pow(100.5 / 255, 1.5), 1e-4);

  const MicroLensSpec lenses =
      *ReadTarget({{"lenses",
                    "pitch: 10, row_pitch: 12, lattice: rectangular, regular_in: raw, "
                    "offset: [1, -2], focus: [2, -1], pattern: [[0, 1, 1], [1, 0, 0]]"}})
           .cameras[1]
           .micro_lenses;
  EXPECT_EQ(lenses.lattice, LatticeKind::kRectangular);
  EXPECT_TRUE(lenses.regular_in_raw);
  EXPECT_EQ(lenses.row_pitch, 12);
  EXPECT_EQ(lenses.offset, Eigen::Vector2d(1, -2));
  EXPECT_THAT(lenses.focus, ElementsAre(2, -1));
  EXPECT_EQ(lenses.pattern, (Eigen::MatrixXi(2, 3) << 0, 1, 1, 1, 0, 0).finished());

  const RigidTransform by_xi =
      ReadTarget({{"raw", "    xi_camera_rig: [1, 2, 3, 0, 0, 0.5]"}}).cameras[1].T_camera_rig;
  EXPECT_TRUE(by_xi.R.isApprox(ExpRotation({0, 0, 0.5})));
  const RigidTransform by_T =
      ReadTarget(
          {{"raw", "    T_camera_rig: [[0, -1, 0, 4], [1, 0, 0, 5], [0, 0, 1, 6], [0, 0, 0, 1]]"}})
          .cameras[1]
          .T_camera_rig;
  EXPECT_EQ(by_T.t, Eigen::Vector3d(4, 5, 6));
  EXPECT_TRUE(by_T.R.isApprox(ExpRotation({0, 0, std::numbers::pi / 2}), 1e-9));
}

TEST_F(SimulationSpecFile, ReadsTargetsPosesAimsAndExposures) {
  const SimulationSpec two = ReadTarget(
      {{"target",
        "targets: {floor: a/floor.yaml, wall: {target: wall.yaml, xi_target_own: [1, 2, 3, 0, 0, 0]}}"}});
  ASSERT_EQ(two.targets.size(), 2u);
  EXPECT_EQ(two.targets[0].name, "floor");
  EXPECT_EQ(two.targets[0].file, Path("a/floor.yaml"));
  EXPECT_TRUE(two.targets[0].T_target_own.t.isZero());
  EXPECT_EQ(two.targets[1].name, "wall");
  EXPECT_EQ(two.targets[1].file, Path("wall.yaml"));
  EXPECT_TRUE(two.targets[1].T_target_own.t.isApprox(Eigen::Vector3d(1, 2, 3)));
  const auto aim = [&](const std::string& name) {
    const PoseSpec poses =
        ReadTarget({{"poses", "frames: 1, distance: [1, 1], aim: " + name}}).poses;
    return poses.aim_all ? 100 : poses.aim;
  };
  EXPECT_EQ(aim("left"), 0u);
  EXPECT_EQ(aim("raw"), 1u);
  EXPECT_EQ(aim("all"), 100u);
  const auto exposures = [&](const std::string& text) {
    return *ReadTarget({{"root", "exposures: {range: [1, 4], " + text + "}"}}).exposures;
  };
  EXPECT_TRUE(exposures("order: sweep").sweep);
  EXPECT_FALSE(exposures("order: random").sweep);
  EXPECT_FALSE(exposures("known: false").known);
  EXPECT_EQ(exposures("late: {camera: raw}").late_camera, "raw");
  EXPECT_EQ(exposures("late: {camera: raw}").late_change, 0.1);
  EXPECT_EQ(ReadTarget({{"root", "exposures: {range: [3, 3]}"}}).exposures->largest, 3);
  EXPECT_FALSE(ReadTarget({{"root", "rigid_tags: false"}}).rigid_tags);
}

TEST_F(SimulationSpecFile, RefusesWhatItCannotMake) {
  const std::vector<std::pair<Texts, std::string>> targets{
      {{{"target", "target: ''"}}, "spec.yaml:2:9: target: expected a path, found nothing"},
      {{{"root", "seeds: 1"}}, "spec.yaml:3:1: seeds: unknown key; did you mean 'seed'?"},
      {{{"root", "trajectory: {}"}},
       "spec.yaml:3:13: trajectory: goes with 'scene' in place of 'target' only"},
      {{{"root", "calibration_sigma: {}"}},
       "spec.yaml:3:20: calibration_sigma: goes with 'scene' in place of 'target' only"},
      {{{"root", "targets: {a: b.yaml}"}}, "spec.yaml:3:10: targets: give either this or 'target'"},
      {{{"target", "targets: {a: b.yaml}"}, {"root", "wall: {}"}},
       "spec.yaml:3:7: wall: goes with one target only"},
      {{{"target", "targets: {}"}},
       "spec.yaml:2:10: targets: expected targets: 'floor: floor.yaml'"},
      {{{"target", "targets: {'a b': b.yaml}"}},
       "spec.yaml:2:18: targets.a b: this name has a ' '; it becomes part of file names: use letters, digits, '_' and '-'"},
      {{{"target", "targets: {a: {target: b.yaml, T: 1}}"}},
       "spec.yaml:2:31: targets.a.T: unknown key; known: target, T_target_own, xi_target_own"},
      {{{"size", "[15, 48]"}},
       "spec.yaml:8:17: cameras.left.image_size: expected 16 to 20000 pixels"},
      {{{"size", "[64, 20001]"}},
       "spec.yaml:8:17: cameras.left.image_size: expected 16 to 20000 pixels"},
      {{{"parameters", ", A_9: 1"}},
       "spec.yaml:9:54: cameras.left.parameters.A_9: unknown key; did you mean 'A_0'?"},
      {{{"left", "    bits: 9"}},
       "spec.yaml:10:11: cameras.left.bits: expected 8, 10, 12, 14 or 16, found 9"},
      {{{"left", "    bits: 10\n    response: {gamma: 2}"}},
       "spec.yaml:11:15: cameras.left.response: goes with 8 'bits' only"},
      {{{"left", "    response: {gamma: 2, file: a.txt}"}},
       "spec.yaml:10:15: cameras.left.response: expected either 'gamma' or 'file'"},
      {{{"left", "    response: {}"}},
       "spec.yaml:10:15: cameras.left.response: expected either 'gamma' or 'file'"},
      {{{"left", "    response: {gamma: 0.19}"}},
       "spec.yaml:10:23: cameras.left.response.gamma: expected a number from 0.2 to 5, found 0.19"},
      {{{"left", "    response: {gamma: 5.1}"}},
       "spec.yaml:10:23: cameras.left.response.gamma: expected a number from 0.2 to 5, found 5.1"},
      {{{"left", "    response: {gama: 1}"}},
       "spec.yaml:10:16: cameras.left.response.gama: unknown key; did you mean 'gamma'?"},
      {{{"left", "    vignetting: -0.01"}},
       "spec.yaml:10:17: cameras.left.vignetting: expected a number from 0 to 0.95, found -0.01"},
      {{{"left", "    vignetting: {polynomial: []}"}},
       "spec.yaml:10:30: cameras.left.vignetting.polynomial: expected one to three coefficients, of r^2, r^4 and r^6"},
      {{{"left", "    vignetting: {polynomial: [1, 2, 3, 4]}"}},
       "spec.yaml:10:30: cameras.left.vignetting.polynomial: expected one to three coefficients, of r^2, r^4 and r^6"},
      {{{"left", "    vignetting: {polynomial: [1], axes: [0, 1]}"}},
       "spec.yaml:10:41: cameras.left.vignetting.axes: expected two positive numbers"},
      {{{"left", "    vignetting: {polynomial: [1], axes: [1, 0]}"}},
       "spec.yaml:10:41: cameras.left.vignetting.axes: expected two positive numbers"},
      {{{"left", "    bayer: rgbg"}},
       "spec.yaml:10:12: cameras.left.bayer: expected RGGB or BGGR or GRBG or GBRG, found 'rgbg'; did you mean 'RGGB'?"},
      {{{"left", "    micro_lenses: {}"}},
       "spec.yaml:10:19: cameras.left.micro_lenses: model pinhole-radial3 has no micro lenses"},
      {{{"left", "    pixel_size: 1"}},
       "spec.yaml:10:5: cameras.left.pixel_size: unknown key; did you mean 'image_size'?"},
      {{{"left", "    T_camera_rig: [[1, 0, 0, 0.1], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"}},
       "spec.yaml:6:3: cameras: the first camera is the rig's frame; give it no T_camera_rig"},
      {{{"left", "    xi_camera_rig: [0, 0, 0, 0, 0.01, 0]"}},
       "spec.yaml:6:3: cameras: the first camera is the rig's frame; give it no T_camera_rig"},
      {{{"left", "    time_offset: 0"}},
       "spec.yaml:10:18: cameras.left.time_offset: goes with 'poses: {kind: moving}'"},
      {{{"left", "    time_shift: 0"}},
       "spec.yaml:10:17: cameras.left.time_shift: goes with 'poses: {kind: moving}'"},
      {{{"raw", "    vignetting: 0.1"}},
       "spec.yaml:17:17: cameras.raw.vignetting: a plenoptic camera's vignetting comes from its stop; see 'fill'"},
      {{{"raw",
         "    xi_camera_rig: [0, 0, 0, 0, 0, 0]\n"
         "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]"}},
       "spec.yaml:17:20: cameras.raw.xi_camera_rig: give either this or T_camera_rig"},
      {{{"lenses", "focus: [2]"}},
       "spec.yaml:16:19: cameras.raw.micro_lenses.pitch: this key is missing; add 'pitch: ...'"},
      {{{"lenses", "pitch: 10, focus: []"}},
       "spec.yaml:16:38: cameras.raw.micro_lenses.focus: expected one to 4 virtual depths, found 0"},
      {{{"lenses", "pitch: 10, focus: [1, 2, 3, 4, 5]"}},
       "spec.yaml:16:38: cameras.raw.micro_lenses.focus: expected one to 4 virtual depths, found 5"},
      {{{"lenses", "pitch: 10, focus: [0.99]"}},
       "spec.yaml:16:38: cameras.raw.micro_lenses.focus: expected virtual depths of at least 1, or at most -1 for a Keplerian camera"},
      {{{"lenses", "pitch: 10, focus: [-0.99]"}},
       "spec.yaml:16:38: cameras.raw.micro_lenses.focus: expected virtual depths of at least 1, or at most -1 for a Keplerian camera"},
      {{{"lenses", "pitch: 10, focus: [2, 3]"}},
       "spec.yaml:16:38: cameras.raw.micro_lenses.focus: 2 lens types need a 'pattern': rows of their numbers 0 to 1, which repeat over the array"},
      {{{"lenses", "pitch: 10, focus: [2], row_pitch: 10"}},
       "spec.yaml:16:54: cameras.raw.micro_lenses.row_pitch: the rows of a hexagonal lattice follow from 'pitch'"},
      {{{"lenses", "pitch: 10, focus: [2], lattice: square"}},
       "spec.yaml:16:52: cameras.raw.micro_lenses.lattice: expected hexagonal or rectangular, found 'square'"},
      {{{"lenses", "pitch: 10, focus: [2], regular_in: space"}},
       "spec.yaml:16:55: cameras.raw.micro_lenses.regular_in: expected undistorted or raw, found 'space'"},
      {{{"lenses", "pitch: 10, focus: [2], pattern: []"}},
       "spec.yaml:16:52: cameras.raw.micro_lenses.pattern: expected 1 to 12 rows"},
      {{{"lenses",
         "pitch: 10, focus: [2], pattern: [[0],[0],[0],[0],[0],[0],[0],[0],[0],[0],[0],[0],[0]]"}},
       "spec.yaml:16:52: cameras.raw.micro_lenses.pattern: expected 1 to 12 rows"},
      {{{"lenses", "pitch: 10, focus: [2], pattern: [[]]"}},
       "spec.yaml:16:53: cameras.raw.micro_lenses.pattern[0]: expected 1 to 12 lens types"},
      {{{"lenses", "pitch: 10, focus: [2], pattern: [[0,0,0,0,0,0,0,0,0,0,0,0,0]]"}},
       "spec.yaml:16:53: cameras.raw.micro_lenses.pattern[0]: expected 1 to 12 lens types"},
      {{{"lenses", "pitch: 10, focus: [2], pattern: [[0, 0], [0]]"}},
       "spec.yaml:16:61: cameras.raw.micro_lenses.pattern[1]: expected 2 lens types as in the first row, found 1"},
      {{{"lenses", "pitch: 10, focus: [2], pattern: [[1]]"}},
       "spec.yaml:16:54: cameras.raw.micro_lenses.pattern[0][0]: expected the number of a lens type, 0 to 0: the place of its virtual depth in 'focus'"},
      {{{"lenses", "pitch: 10, focus: [2], pattern: [[-1]]"}},
       "spec.yaml:16:54: cameras.raw.micro_lenses.pattern[0][0]: expected the number of a lens type, 0 to 0: the place of its virtual depth in 'focus'"},
      {{{"lenses", "pitch: 10, focus: [2, 3], pattern: [[1]]"}},
       "spec.yaml:16:55: cameras.raw.micro_lenses.pattern: has no lens type 0"},
      {{{"poses", "frames: 4, distance: [0, 1]"}},
       "spec.yaml:4:30: poses.distance: expected [nearest, farthest] in metres"},
      {{{"poses", "frames: 4, distance: [2, 1]"}},
       "spec.yaml:4:30: poses.distance: expected [nearest, farthest] in metres"},
      {{{"poses", "distance: [1, 2]"}},
       "spec.yaml:4:8: poses.frames: this key is missing; add 'frames: ...'"},
      {{{"poses", "frames: 4, distance: [1, 2], rate: 10"}},
       "spec.yaml:4:44: poses.rate: goes with 'kind: moving'"},
      {{{"poses", "frames: 4, distance: [1, 2], aim: lefty"}},
       "spec.yaml:4:43: poses.aim: no camera is named 'lefty'; did you mean 'left'?"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: [still, moving]"}},
       "spec.yaml:4:44: poses.kind: 'still' and 'moving' exclude each other"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: [varied, corner]"}},
       "spec.yaml:4:44: poses.kind: 'varied' goes with no other kind"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: [varied, no-tilt]"}},
       "spec.yaml:4:44: poses.kind: 'varied' goes with no other kind"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: [varied, one-distance]"}},
       "spec.yaml:4:44: poses.kind: 'varied' goes with no other kind"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: []"}},
       "spec.yaml:4:44: poses.kind: the list is empty; write 'varied'"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: tilted"}},
       "spec.yaml:4:44: poses.kind: expected varied or one-distance or no-tilt or corner or still or moving, found 'tilted'; known: varied, one-distance, no-tilt, corner, still, moving"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: moving, aim: all"}},
       "spec.yaml:4:8: poses: 'kind: moving' goes with one target, one aim and no 'exposures'"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: moving"},
        {"root", "exposures: {range: [1, 2]}"}},
       "spec.yaml:4:8: poses: 'kind: moving' goes with one target, one aim and no 'exposures'"},
      {{{"poses", "frames: 4, distance: [1, 2], kind: moving"},
        {"target", "targets: {a: a.yaml, b: b.yaml}"}},
       "spec.yaml:4:8: poses: 'kind: moving' goes with one target, one aim and no 'exposures'"},
      {{{"root", "exposures: {range: [0, 2]}"}},
       "spec.yaml:3:20: exposures.range: expected [least, largest] in ms"},
      {{{"root", "exposures: {range: [2, 1]}"}},
       "spec.yaml:3:20: exposures.range: expected [least, largest] in ms"},
      {{{"root", "exposures: {range: [1, 2], order: up}"}},
       "spec.yaml:3:35: exposures.order: expected sweep or random, found 'up'; known: sweep, random"},
      {{{"root", "exposures: {range: [1, 2], late: {camera: middle}}"}},
       "spec.yaml:3:43: exposures.late.camera: no camera is named 'middle'"},
      {{{"root", "wall: {flat: 1}"}},
       "spec.yaml:3:8: wall.flat: unknown key; known: contrast, structure, light, gloss, shading, fold, fold_angle"},
  };
  for (const auto& [texts, message] : targets) EXPECT_EQ(Target(texts), message);
}

TEST_F(SimulationSpecFile, RefusesScenesThatItCannotMake) {
  const std::vector<std::pair<Texts, std::string>> scenes{
      {{{"root", "target: board.yaml"}},
       "spec.yaml:5:9: target: 'scene' is in place of 'target' and 'poses'"},
      {{{"root", "targets: {}"}},
       "spec.yaml:5:10: targets: 'scene' is in place of 'target' and 'poses'"},
      {{{"root", "target_error: 0.1"}},
       "spec.yaml:5:15: target_error: 'scene' is in place of 'target' and 'poses'"},
      {{{"root", "rigid_tags: true"}},
       "spec.yaml:5:13: rigid_tags: 'scene' is in place of 'target' and 'poses'"},
      {{{"root", "poses: {}"}},
       "spec.yaml:5:8: poses: 'scene' is in place of 'target' and 'poses'"},
      {{{"root", "wall: {}"}}, "spec.yaml:5:7: wall: 'scene' is in place of 'target' and 'poses'"},
      {{{"root", "exposures: {}"}},
       "spec.yaml:5:12: exposures: 'scene' is in place of 'target' and 'poses'"},
      {{{"scene", "near: 7"}},
       "spec.yaml:2:8: scene: 'far' (6 m) must be greater than 'near' (7 m)"},
      {{{"scene", "near: 2, far: 2"}},
       "spec.yaml:2:23: scene.far: 'far' (2 m) must be greater than 'near' (2 m)"},
      {{{"scene", "depth: 2"}},
       "spec.yaml:2:9: scene.depth: unknown key; known: points, near, far, boxes, moving, track_length, wrong_matches, merged, distances, distance_sigma"},
      {{{"sigma", "parameters: {middle: {}}"}},
       "spec.yaml:4:34: calibration_sigma.parameters.middle: unknown key; known: left, raw"},
      {{{"sigma", "parameters: {left: {f: 1}}"}},
       "spec.yaml:4:41: calibration_sigma.parameters.left.f: unknown key; known: f_x, f_y, c_x, c_y, A_0, A_1, A_2"},
      {{{"trajectory", "kind: [loop, handheld], frames: 3"}},
       "spec.yaml:3:20: trajectory.kind: give either 'loop' or 'handheld'"},
      {{{"trajectory", "kind: [handheld, straight], frames: 3"}},
       "spec.yaml:3:20: trajectory.kind: 'straight' goes with 'loop' only"},
      {{{"trajectory", "kind: [handheld, no-overlap], frames: 3"}},
       "spec.yaml:3:20: trajectory.kind: 'no-overlap' goes with 'loop' only"},
      {{{"trajectory", "kind: [handheld, repeated], frames: 3"}},
       "spec.yaml:3:20: trajectory.kind: 'repeated' goes with 'loop' only"},
      {{{"trajectory", "kind: no-turning"}},
       "spec.yaml:3:20: trajectory.kind: 'no-turning' goes with 'handheld' only"},
      {{{"trajectory", "kind: [repeated, straight]"}},
       "spec.yaml:3:20: trajectory.kind: 'repeated' goes with neither 'straight' nor 'rotation'"},
      {{{"trajectory", "kind: [repeated, rotation]"}},
       "spec.yaml:3:20: trajectory.kind: 'repeated' goes with neither 'straight' nor 'rotation'"},
      {{{"trajectory", "kind: [rotation, straight]"}},
       "spec.yaml:3:20: trajectory.kind: 'rotation' goes with neither 'straight' nor 'no-turning'"},
      {{{"trajectory", "kind: [handheld, rotation, no-turning], frames: 3"}},
       "spec.yaml:3:20: trajectory.kind: 'rotation' goes with neither 'straight' nor 'no-turning'"},
      {{{"trajectory", "kind: handheld"}},
       "spec.yaml:3:13: trajectory.frames: this key is missing; add 'frames: ...'"},
      {{{"trajectory", "kind: round"}},
       "spec.yaml:3:20: trajectory.kind: expected loop or handheld or straight or far or rotation or one-depth or no-turning or no-overlap or repeated, found 'round'; known: loop, handheld, straight, far, rotation, one-depth, no-turning, no-overlap, repeated"},
      {{{"trajectory", "kind: []"}},
       "spec.yaml:3:20: trajectory.kind: the list is empty; write 'loop' or 'handheld'"},
      {{{"trajectory", "length: 29.9"}},
       "spec.yaml:3:22: trajectory.length: 29.9 m are walked in 29.9 s: shorter than a start and an end of 15 s each"},
      {{{"trajectory", "segment: 60, speed: 2"}},
       "spec.yaml:3:13: trajectory: 100 m are walked in 50 s: shorter than a start and an end of 60 s each"},
      {{{"trajectory", "kind: straight, overlap: 0.5, length: 40.6"}},
       "spec.yaml:3:52: trajectory.length: a straight start and end need a path of at least 40.64 m"},
      {{{"trajectory", "file: none.txt, rate: 3"}},
       "spec.yaml:3:30: trajectory.rate: unknown key; did you mean 'frames'?"},
  };
  for (const auto& [texts, message] : scenes) EXPECT_EQ(Scene(texts), message);
  // At the limits themselves.
  ReadScene({{"trajectory", "length: 30"}});
  ReadScene({{"trajectory", "kind: straight, overlap: 0.5, length: 40.65"}});
  ReadTarget({{"lenses", "pitch: 10, focus: [1, -1, 2, 3], pattern: [[0, 1, 2, 3]]"}});
  ReadTarget({{"lenses", "pitch: 10, focus: [2], pattern: [[0,0,0,0,0,0,0,0,0,0,0,0]]"}});
  ReadTarget(
      {{"lenses",
        "pitch: 10, focus: [2], pattern: [[0],[0],[0],[0],[0],[0],[0],[0],[0],[0],[0],[0]]"}});
  std::string none = Filled(kTargetSpec, {});
  none.resize(none.find("cameras:"));
  EXPECT_EQ(Message(none + "cameras: {}\n"),
            "spec.yaml:5:10: cameras: expected at least one camera");
  for (const char* name : {"''", "truth", "a/b"}) {
    EXPECT_THAT(Message(none + "cameras: {" + name + ": {}}\n"),
                ::testing::EndsWith(": a camera's name becomes part of file names; use letters, "
                                    "digits, '_' and '-', not 'truth'"));
  }
}

TEST_F(SimulationSpecFile, KnowsUsualPatterns) {
  const auto usual = [](LatticeKind lattice, size_t types) {
    const auto pattern = UsualPattern(lattice, types);
    std::string text;
    for (int r = 0; pattern && r < pattern->rows(); ++r) {
      for (int c = 0; c < pattern->cols(); ++c) text += std::to_string((*pattern)(r, c));
      text += ' ';
    }
    return text;
  };
  constexpr LatticeKind kHexagonal = LatticeKind::kHexagonal,
                        kRectangular = LatticeKind::kRectangular;
  EXPECT_EQ(usual(kHexagonal, 1), "0 ");
  EXPECT_EQ(usual(kHexagonal, 2), "");
  EXPECT_EQ(usual(kHexagonal, 3), "012 201 120 ");
  EXPECT_EQ(usual(kHexagonal, 4), "");
  EXPECT_EQ(usual(kRectangular, 1), "0 ");
  EXPECT_EQ(usual(kRectangular, 2), "01 10 ");
  EXPECT_EQ(usual(kRectangular, 3), "");
  EXPECT_EQ(usual(kRectangular, 4), "01 23 ");
}

TEST_F(SimulationSpecFile, IsWrittenAsKeysOfSessionsAndRecords) {
  const SimulationSpec spec =
      ReadTarget({{"left", "    bayer: BGGR"}, {"raw", "    xi_camera_rig: [1, 2, 3, 0, 0, 0]"}});
  const CameraSpec &left = spec.cameras[0], &raw = spec.cameras[1];
  EXPECT_EQ(ImageKeys(left, false), "    images: left/*.png\n");
  EXPECT_EQ(ImageKeys(raw, true), "    images: raw/*.png\n    white_images: raw_white/*.png\n");
  EXPECT_EQ(BayerKey(left), "    bayer: BGGR\n");
  EXPECT_EQ(BayerKey(raw), "");
  EXPECT_EQ(ConfigKeys(left), "");
  EXPECT_EQ(ConfigKeys(raw), "    pixel_size: 7.4e-06\n");
  EXPECT_EQ(ModelKeys(left), "  left:\n    model: pinhole-radial3\n");
  EXPECT_EQ(DetectionKeys(left, "a.csv"), "    detections: a.csv\n    image_size: [64, 48]\n");
  const CalibrationRecord record = TrueRecord(spec);
  ASSERT_EQ(record.cameras.size(), 2u);
  EXPECT_TRUE(record.adjustment->converged);
  EXPECT_EQ(record.cameras[1].name, "raw");
  EXPECT_EQ(record.cameras[1].params, raw.params);
  EXPECT_EQ(record.cameras[1].config, raw.config);
  EXPECT_EQ(record.cameras[0].image_size, left.image_size);
  EXPECT_EQ(record.cameras[0].covariance, Eigen::MatrixXd::Zero(7, 7));
  EXPECT_TRUE(record.cameras[1].T_camera_rig.t.isApprox(Eigen::Vector3d(1, 2, 3)));
  const auto provenance = [](bool points) {
    std::string text;
    for (const auto& [key, value] : SimulationProvenance({"a.yaml", "b", points}, "prog"))
      text += key + "=" + value + ";";
    return text;
  };
  EXPECT_THAT(provenance(false),
              ::testing::MatchesRegex("plenocal_version=[0-9.]+;command=prog simulate a.yaml -o b;"
                                      "simulation=the parameters are true, not estimated;"));
  EXPECT_THAT(
      provenance(true),
      ::testing::MatchesRegex(".*;command=prog simulate a.yaml -o b --points;simulation=.*"));
}

}  // namespace TEST_FILE
}  // namespace plenocal::simulate
