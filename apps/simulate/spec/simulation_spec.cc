// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/spec/simulation_spec.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/simulate/spec/spec_values.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/base/number_text.h"
#include "calib/base/quoted_text.h"
#include "calib/camera/micro_lens_array.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/files/checks/transform_keys.h"
#include "calib/io/yaml.h"

namespace plenocal::simulate {
namespace {

// One value a parameter, all of them.
std::vector<double> ReadParams(const YamlNode& node, std::span<const Param> params) {
  node.CheckKeys(NamesOf(params));
  std::vector<double> values;
  for (const Param& param : params) {
    if (!node.Has(param.name) && param.neutral) {
      values.push_back(*param.neutral);
      continue;
    }
    values.push_back(ReadWithin(node.At(param.name), param));
  }
  return values;
}

// The pose of the keys T_... and xi_... with this ending; identity without them.
RigidTransform ReadPose(const YamlNode& node, const std::string& ending) {
  const std::string T_key = "T_" + ending, xi_key = "xi_" + ending;
  if (node.Has(xi_key) && node.Has(T_key)) {
    node.At(xi_key).Fail(fmt::format("give either this or {}", T_key));
  }
  if (node.Has(xi_key)) return ReadXi(node.At(xi_key));
  return node.Has(T_key) ? ReadTransform(node.At(T_key)) : RigidTransform{};
}

/// The key `pattern` of `node`, or the usual one of the lens types.
Eigen::MatrixXi ReadPattern(const YamlNode& node, const MicroLensSpec& lenses) {
  const auto types = static_cast<int>(lenses.focus.size());
  if (!node.Has("pattern")) {
    const auto usual = UsualPattern(lenses.lattice, lenses.focus.size());
    if (!usual) {
      node.At("focus").Fail(fmt::format(
          "{} lens types need a 'pattern': rows of their numbers 0 to {}, which repeat over the array",
          types,
          types - 1));
    }
    return *usual;
  }
  const YamlNode pattern = node.At("pattern");
  const std::vector<YamlNode> rows = pattern.Elements();
  constexpr size_t kLargest = 12;
  if (rows.empty() || rows.size() > kLargest) pattern.Fail("expected 1 to 12 rows");
  Eigen::MatrixXi numbers;
  for (size_t r = 0; r < rows.size(); ++r) {
    const std::vector<YamlNode> row = rows[r].Elements();
    if (row.empty() || row.size() > kLargest) rows[r].Fail("expected 1 to 12 lens types");
    if (r == 0) numbers.setZero(static_cast<int>(rows.size()), static_cast<int>(row.size()));
    if (static_cast<int>(row.size()) != numbers.cols()) {
      rows[r].Fail(fmt::format(
          "expected {} lens types as in the first row, found {}", numbers.cols(), row.size()));
    }
    for (size_t c = 0; c < row.size(); ++c) {
      const int number = row[c].AsInteger();
      if (number < 0 || number >= types) {
        row[c].Fail(
            fmt::format("expected the number of a lens type, 0 to {}: the place of its "
                        "virtual depth in 'focus'",
                        types - 1));
      }
      numbers(static_cast<int>(r), static_cast<int>(c)) = number;
    }
  }
  for (int type = 0; type < types; ++type) {
    if ((numbers.array() != type).all()) pattern.Fail(fmt::format("has no lens type {}", type));
  }
  return numbers;
}

MicroLensSpec ReadMicroLenses(const YamlNode& node) {
  MicroLensSpec lenses;
  std::optional<double> row_pitch;
  ReadKeys(node,
           {{"pitch", &lenses.pitch, 6, 500},
            {"row_pitch", &row_pitch, 6, 500},
            {"rotation", &lenses.rotation, -2 * std::numbers::pi, 2 * std::numbers::pi},
            {"aperture", &lenses.aperture, 0.01, 1},
            {"fill", &lenses.fill, 0.1, 1.5},
            {"gain_sigma", &lenses.gain_sigma, 0, 0.2},
            {"dull", &lenses.dull, 0, 1000}},
           {"lattice", "offset", "focus", "pattern", "regular_in"});
  // Whether a key has the second of two values.
  const auto is_second = [&](const char* key, std::string_view first, std::string_view second) {
    const std::string name = node.Has(key) ? node.At(key).AsString() : std::string(first);
    if (name != first && name != second) {
      node.At(key).Fail(fmt::format("expected {} or {}, found '{}'", first, second, name));
    }
    return name == second;
  };
  if (is_second("lattice", "hexagonal", "rectangular")) lenses.lattice = LatticeKind::kRectangular;
  lenses.regular_in_raw = is_second("regular_in", "undistorted", "raw");
  lenses.pitch = node.At("pitch").AsPositive();
  lenses.row_pitch = row_pitch.value_or(lenses.pitch);
  if (row_pitch && lenses.lattice == LatticeKind::kHexagonal) {
    node.At("row_pitch").Fail("the rows of a hexagonal lattice follow from 'pitch'");
  }
  if (node.Has("offset")) {
    lenses.offset = Eigen::Vector2d(node.At("offset").AsNumbers(2).data());
  }
  const YamlNode focus = node.At("focus");
  lenses.focus = focus.AsNumbers(0);
  if (lenses.focus.empty() || lenses.focus.size() > kMostLensTypes) {
    focus.Fail(fmt::format(
        "expected one to {} virtual depths, found {}", kMostLensTypes, lenses.focus.size()));
  }
  lenses.pattern = ReadPattern(node, lenses);
  for (const double depth : lenses.focus) {
    if (!(std::abs(depth) >= 1)) {
      focus.Fail("expected virtual depths of at least 1, or at most -1 for a Keplerian camera");
    }
  }
  return lenses;
}

SensorSpec ReadSensor(const YamlNode& node,
                      const CameraSpec& camera,
                      const std::filesystem::path& spec) {
  SensorSpec sensor = camera.sensor;
  if (node.Has("bits")) {
    sensor.bits = node.At("bits").AsInteger();
    constexpr std::array kBits{8, 10, 12, 14, 16};
    if (std::ranges::find(kBits, sensor.bits) == kBits.end()) {
      node.At("bits").Fail(fmt::format("expected 8, 10, 12, 14 or 16, found {}", sensor.bits));
    }
  }
  if (camera.IsPlenoptic() && node.Has("vignetting")) {
    node.At("vignetting").Fail("a plenoptic camera's vignetting comes from its stop; see 'fill'");
  }
  if (node.Has("vignetting") && node.At("vignetting").IsMap()) {
    sensor.vignetting = ReadVignettingSpec(node.At("vignetting"));
  } else if (node.Has("vignetting")) {
    sensor.vignetting.polynomial[0] = -NumberWithin(node.At("vignetting"), 0, 0.95);
  }
  if (node.Has("response")) {
    sensor.response = ReadToneSpec(node.At("response"), spec);
    if (sensor.bits != 8) node.At("response").Fail("goes with 8 'bits' only");
  }
  if (node.Has("bayer")) {
    sensor.bayer = static_cast<BayerOrder>(ReadChoice(node.At("bayer"), kBayerOrders));
  }
  return sensor;
}

CameraSpec ReadCamera(const std::string& name,
                      const YamlNode& node,
                      const std::filesystem::path& spec,
                      std::span<const CameraModel> models) {
  CameraSpec camera;
  camera.name = name;
  if (name.empty() || name == "truth" ||
      name.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-") !=
          std::string::npos) {
    node.Fail(
        "a camera's name becomes part of file names; use letters, digits, '_' and '-', not "
        "'truth'");
  }
  camera.model = ReadModel(node.At("model"), models);
  std::vector<std::string_view> others{"model",
                                       "image_size",
                                       "parameters",
                                       "T_camera_rig",
                                       "xi_camera_rig",
                                       "bits",
                                       "vignetting",
                                       "response",
                                       "bayer",
                                       "micro_lenses"};
  for (const Param& config : camera.model->config) others.push_back(config.name);
  constexpr double kLongest = 10;  // s
  ReadKeys(node,
           {{"full_well", &camera.sensor.full_well, 10, 1e9},
            {"read_noise", &camera.sensor.read_noise, 0, 1e6},
            {"exposure", &camera.sensor.exposure, 0.01, 1},
            {"blur", &camera.sensor.blur, 0, 20},
            {"detection_sigma", &camera.detection_sigma, 0, 1e6},
            {"time_offset", &camera.time_offset, -kLongest, kLongest},
            {"time_shift", &camera.time_shift, -kLongest, kLongest}},
           std::move(others));

  const YamlNode size = node.At("image_size");
  camera.image_size = ReadImageSize(size);
  for (const int pixels : camera.image_size) {
    if (pixels < 16 || pixels > 20000) size.Fail("expected 16 to 20000 pixels");
  }
  for (const Param& config : camera.model->config) {
    camera.config.push_back(ReadWithin(node.At(config.name), config));
  }
  camera.params = ReadParams(node.At("parameters"), camera.model->params);
  camera.T_camera_rig = ReadPose(node, "camera_rig");
  camera.sensor = ReadSensor(node, camera, spec);
  if (camera.IsPlenoptic()) {
    camera.micro_lenses = ReadMicroLenses(node.At("micro_lenses"));
  } else if (node.Has("micro_lenses")) {
    node.At("micro_lenses").Fail(fmt::format("model {} has no micro lenses", camera.model->name));
  }
  return camera;
}

PoseSpec ReadPoseSpec(const YamlNode& node,
                      const std::filesystem::path& spec,
                      const std::vector<CameraSpec>& cameras) {
  PoseSpec poses;
  if (node.Has("file")) {
    node.CheckKeys({"file"});
    const std::filesystem::path path = PathBeside(spec, node.At("file"));
    poses.given = ReadPoses(path);
    if (poses.given.empty()) {
      throw Error(ErrorKind::kInput, path.string() + ": expected at least one pose");
    }
    return poses;
  }
  ReadKeys(node,
           {{"frames", &poses.frames, 1, 100000},
            {"rate", &poses.rate, 0.1, 1e5},
            {"tilt", &poses.tilt, 0, 1.4},
            {"roll", &poses.roll, 0, std::numbers::pi},
            {"partial", &poses.partial, 0, 1}},
           {"kind", "distance", "aim"});
  if (node.Has("kind")) {
    const YamlNode kind = node.At("kind");
    bool varied = false;
    ReadFlags(kind,
              std::to_array<SpecFlag>({{"varied", &varied},
                                       {"one-distance", &poses.one_distance},
                                       {"no-tilt", &poses.no_tilt},
                                       {"corner", &poses.corner},
                                       {"still", &poses.still},
                                       {"moving", &poses.moving}}),
              "'varied'");
    if (poses.still && poses.moving) kind.Fail("'still' and 'moving' exclude each other");
    if (varied && (poses.one_distance || poses.no_tilt || poses.corner)) {
      kind.Fail("'varied' goes with no other kind");
    }
  }
  poses.frames = node.At("frames").AsInteger();
  const YamlNode distance = node.At("distance");
  const std::vector<double> range = distance.AsSignedLengths(2);
  poses.nearest = range[0];
  poses.farthest = range[1];
  if (!(poses.nearest > 0 && poses.farthest >= poses.nearest)) {
    distance.Fail("expected [nearest, farthest] in metres");
  }
  if (node.Has("rate") && !poses.moving) node.At("rate").Fail("goes with 'kind: moving'");
  if (node.Has("aim")) {
    const std::string name = node.At("aim").AsString();
    const std::vector<std::string_view> names = NamesOf(cameras);
    const auto found = std::ranges::find(names, name);
    poses.aim_all = found == names.end() && name == "all";
    if (found == names.end() && !poses.aim_all) {
      node.At("aim").Fail(fmt::format("no camera is named '{}'{}", name, SuggestName(name, names)));
    }
    if (!poses.aim_all) poses.aim = static_cast<size_t>(found - names.begin());
  }
  return poses;
}

// A file, or {target, T_target_own} of another target than the first.
TargetSpec ReadTargetSpec(const std::string& name,
                          const YamlNode& node,
                          const std::filesystem::path& spec) {
  CheckName(name, node);  // it becomes part of file names too
  if (!node.IsMap()) return {.name = name, .file = PathBeside(spec, node), .T_target_own = {}};
  node.CheckKeys({"target", "T_target_own", "xi_target_own"});
  return {.name = name,
          .file = PathBeside(spec, node.At("target")),
          .T_target_own = ReadPose(node, "target_own")};
}

void ReadTargetAndPoses(const YamlNode& root, SimulationSpec* spec) {
  for (const char* key : {"trajectory", "calibration_sigma"}) {
    if (root.Has(key)) root.At(key).Fail("goes with 'scene' in place of 'target' only");
  }
  if (root.Has("targets")) {
    if (root.Has("target")) root.At("targets").Fail("give either this or 'target'");
    if (root.Has("wall")) root.At("wall").Fail("goes with one target only");
    for (const auto& [name, node] : root.At("targets").Entries()) {
      spec->targets.push_back(ReadTargetSpec(name, node, spec->path));
    }
    if (spec->targets.empty()) root.At("targets").Fail("expected targets: 'floor: floor.yaml'");
  } else {
    spec->targets = {{"", PathBeside(spec->path, root.At("target")), {}}};
  }
  if (root.Has("wall")) spec->wall = ReadWallSpec(root.At("wall"));
  if (root.Has("exposures")) {
    const std::vector<std::string_view> names = NamesOf(spec->cameras);
    spec->exposures = ReadExposureSpec(root.At("exposures"), {names.begin(), names.end()});
  }
  spec->poses = ReadPoseSpec(root.At("poses"), spec->path, spec->cameras);
  const PoseSpec& poses = spec->poses;
  if (poses.moving && (spec->exposures || poses.aim_all || spec->targets.size() > 1)) {
    root.At("poses").Fail("'kind: moving' goes with one target, one aim and no 'exposures'");
  }
  for (const auto& [name, camera] : root.At("cameras").Entries()) {
    for (const char* key : {"time_offset", "time_shift"}) {
      if (camera.Has(key) && !poses.moving)
        camera.At(key).Fail("goes with 'poses: {kind: moving}'");
    }
  }
}

void CheckParameterSigmas(const YamlNode& root, const std::vector<CameraSpec>& cameras) {
  if (!root.Has("calibration_sigma") || !root.At("calibration_sigma").Has("parameters")) return;
  const YamlNode sigmas = root.At("calibration_sigma").At("parameters");
  sigmas.CheckKeys(NamesOf(cameras));
  for (const CameraSpec& camera : cameras) {
    if (sigmas.Has(camera.name)) sigmas.At(camera.name).CheckKeys(NamesOf(camera.model->params));
  }
}

void ReadSceneAndTrajectory(const YamlNode& root, SimulationSpec* spec) {
  for (const char* key :
       {"target", "targets", "target_error", "rigid_tags", "poses", "wall", "exposures"}) {
    if (root.Has(key)) root.At(key).Fail("'scene' is in place of 'target' and 'poses'");
  }
  spec->scenery = ReadScenery(root, spec->path);
  CheckParameterSigmas(root, spec->cameras);
}

}  // namespace

std::optional<Eigen::MatrixXi> UsualPattern(LatticeKind lattice, size_t types) {
  if (types == 1) return Eigen::MatrixXi::Zero(1, 1);
  if (lattice == LatticeKind::kHexagonal) {
    if (types != 3) return std::nullopt;
    return (Eigen::Matrix3i() << 0, 1, 2, 2, 0, 1, 1, 2, 0).finished();
  }
  if (types == 2) return (Eigen::Matrix2i() << 0, 1, 1, 0).finished();
  if (types == 4) return (Eigen::Matrix2i() << 0, 1, 2, 3).finished();
  return std::nullopt;
}

CalibrationRecord TrueRecord(const SimulationSpec& spec) {
  CalibrationRecord record;
  record.adjustment = AdjustmentRecord{.converged = true};
  for (const CameraSpec& camera : spec.cameras) {
    const auto count = static_cast<Eigen::Index>(camera.params.size());
    record.cameras.push_back({.name = camera.name,
                              .model = camera.model,
                              .image_size = camera.image_size,
                              .config = camera.config,
                              .params = camera.params,
                              .covariance = Eigen::MatrixXd::Zero(count, count),
                              .T_camera_rig = camera.T_camera_rig});
  }
  return record;
}

Provenance SimulationProvenance(const SimulateRequest& request,
                                const std::string& program,
                                std::string_view what) {
  return {{"plenocal_version", PLENOCAL_VERSION},
          {"command",
           fmt::format("{} simulate {} -o {}{}",
                       program,
                       request.spec.string(),
                       request.out.string(),
                       request.points ? " --points" : "")},
          {"simulation", std::string(what)}};
}

std::string ImageKeys(const CameraSpec& camera, bool white) {
  std::string text = fmt::format("    images: {}/*.png\n", camera.name);
  if (white) text += fmt::format("    white_images: {}_white/*.png\n", camera.name);
  return text;
}

std::string BayerKey(const CameraSpec& camera) {
  const std::optional<BayerOrder>& bayer = camera.sensor.bayer;
  return bayer ? fmt::format("    bayer: {}\n", BayerName(*bayer)) : "";
}

std::string ConfigKeys(const CameraSpec& camera) {
  std::string text;
  for (size_t i = 0; i < camera.config.size(); ++i) {
    text += fmt::format("    {}: {}\n", camera.model->config[i].name, YamlNumber(camera.config[i]));
  }
  return text;
}

std::string ModelKeys(const CameraSpec& camera) {
  return fmt::format("  {}:\n    model: {}\n", YamlText(camera.name), camera.model->name);
}

std::string DetectionKeys(const CameraSpec& camera, const std::string& file) {
  const auto [width, height] = camera.image_size;
  return fmt::format("    detections: {}\n    image_size: [{}, {}]\n", file, width, height);
}

SimulationSpec ReadSimulationSpec(const std::filesystem::path& path,
                                  std::span<const CameraModel> models) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  SimulationSpec spec;
  spec.path = path;
  ReadKeys(root,
           {{"seed", &spec.seed, 0, std::numeric_limits<int>::max()},
            {"target_error", &spec.target_error, 0, 1},
            {"rigid_tags", &spec.rigid_tags},
            {"white_images", &spec.white_images, 1, 1000}},
           {"plenocal",
            "target",
            "targets",
            "cameras",
            "poses",
            "wall",
            "exposures",
            "scene",
            "trajectory",
            "calibration_sigma"});
  const YamlNode cameras = root.At("cameras");
  for (const auto& [name, node] : cameras.Entries()) {
    spec.cameras.push_back(ReadCamera(name, node, path, models));
  }
  if (spec.cameras.empty()) cameras.Fail("expected at least one camera");
  const RigidTransform& master = spec.cameras.front().T_camera_rig;
  if (!(master.R.isIdentity(1e-9) && master.t.norm() < 1e-9)) {
    cameras.Fail("the first camera is the rig's frame; give it no T_camera_rig");
  }
  if (root.Has("scene")) {
    ReadSceneAndTrajectory(root, &spec);
  } else {
    ReadTargetAndPoses(root, &spec);
  }
  return spec;
}

}  // namespace plenocal::simulate
