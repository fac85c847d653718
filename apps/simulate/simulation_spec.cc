// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/simulation_spec.h"

#include <fmt/format.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "apps/simulate/spec_values.h"
#include "calib/base/error.h"
#include "calib/base/names.h"
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
  node.CheckKeys({"lattice",
                  "pitch",
                  "row_pitch",
                  "rotation",
                  "offset",
                  "focus",
                  "pattern",
                  "aperture",
                  "fill",
                  "gain_sigma",
                  "dull"});
  MicroLensSpec lenses;
  if (node.Has("lattice")) {
    const YamlNode lattice = node.At("lattice");
    const std::string name = lattice.AsString();
    if (name != "hexagonal" && name != "rectangular") {
      lattice.Fail(fmt::format("expected hexagonal or rectangular, found '{}'", name));
    }
    if (name == "rectangular") lenses.lattice = LatticeKind::kRectangular;
  }
  lenses.pitch = node.At("pitch").AsPositive();
  ReadNumber(node, "pitch", 6, 500, &lenses.pitch);
  lenses.row_pitch = lenses.pitch;
  if (node.Has("row_pitch") && lenses.lattice == LatticeKind::kHexagonal) {
    node.At("row_pitch").Fail("the rows of a hexagonal lattice follow from 'pitch'");
  }
  ReadNumber(node, "row_pitch", 6, 500, &lenses.row_pitch);
  ReadNumber(node, "rotation", -2 * std::numbers::pi, 2 * std::numbers::pi, &lenses.rotation);
  if (node.Has("offset")) {
    const std::vector<double> offset = node.At("offset").AsNumbers(2);
    lenses.offset = {offset[0], offset[1]};
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
  ReadNumber(node, "aperture", 0.01, 1, &lenses.aperture);
  ReadNumber(node, "fill", 0.1, 1.5, &lenses.fill);
  ReadNumber(node, "gain_sigma", 0, 0.2, &lenses.gain_sigma);
  ReadInteger(node, "dull", 0, 1000, &lenses.dull);
  return lenses;
}

SensorSpec ReadSensor(const YamlNode& node,
                      const CameraSpec& camera,
                      const std::filesystem::path& spec) {
  SensorSpec sensor;
  if (node.Has("bits")) {
    sensor.bits = node.At("bits").AsInteger();
    constexpr std::array kBits{8, 10, 12, 14, 16};
    if (std::find(kBits.begin(), kBits.end(), sensor.bits) == kBits.end()) {
      node.At("bits").Fail(fmt::format("expected 8, 10, 12, 14 or 16, found {}", sensor.bits));
    }
  }
  ReadNumber(node, "full_well", 10, 1e9, &sensor.full_well);
  ReadNumber(node, "read_noise", 0, 1e6, &sensor.read_noise);
  ReadNumber(node, "exposure", 0.01, 1, &sensor.exposure);
  ReadNumber(node, "blur", 0, 20, &sensor.blur);
  if (camera.IsPlenoptic() && node.Has("vignetting")) {
    node.At("vignetting").Fail("a plenoptic camera's vignetting comes from its stop; see 'fill'");
  }
  if (node.Has("vignetting") && node.At("vignetting").IsMap()) {
    sensor.vignetting = ReadVignettingSpec(node.At("vignetting"));
  } else {
    double lost = -sensor.vignetting.polynomial[0];
    ReadNumber(node, "vignetting", 0, 0.95, &lost);
    sensor.vignetting.polynomial[0] = -lost;
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
  std::vector<std::string_view> known{"model",
                                      "image_size",
                                      "parameters",
                                      "T_camera_rig",
                                      "xi_camera_rig",
                                      "bits",
                                      "full_well",
                                      "read_noise",
                                      "exposure",
                                      "blur",
                                      "vignetting",
                                      "response",
                                      "bayer",
                                      "micro_lenses",
                                      "detection_sigma",
                                      "time_offset",
                                      "time_shift"};
  for (const Param& config : camera.model->config) known.push_back(config.name);
  node.CheckKeys(known);

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
  ReadNumber(node, "detection_sigma", 0, 1e6, &camera.detection_sigma);
  constexpr double kLongest = 10;  // s
  ReadNumber(node, "time_offset", -kLongest, kLongest, &camera.time_offset);
  ReadNumber(node, "time_shift", -kLongest, kLongest, &camera.time_shift);
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
  node.CheckKeys({"kind", "frames", "rate", "distance", "tilt", "roll", "partial", "aim"});
  if (node.Has("kind")) {
    static constexpr std::array<std::string_view, 6> kKinds{
        "varied", "one-distance", "no-tilt", "corner", "still", "moving"};
    const YamlNode kind = node.At("kind");
    std::array<bool, kKinds.size()> chosen{};
    for (const YamlNode& item : kind.IsSequence() ? kind.Elements() : std::vector{kind}) {
      chosen[ReadChoice(item, kKinds)] = true;
    }
    if (chosen == decltype(chosen){}) kind.Fail("the list is empty; write 'varied'");
    poses.one_distance = chosen[1];
    poses.no_tilt = chosen[2];
    poses.corner = chosen[3];
    poses.still = chosen[4];
    poses.moving = chosen[5];
    if (poses.still && poses.moving) kind.Fail("'still' and 'moving' exclude each other");
    if (chosen[0] && (poses.one_distance || poses.no_tilt || poses.corner)) {
      kind.Fail("'varied' goes with no other kind");
    }
  }
  poses.frames = node.At("frames").AsInteger();
  ReadInteger(node, "frames", 1, 100000, &poses.frames);
  const YamlNode distance = node.At("distance");
  const std::vector<double> range = distance.AsSignedLengths(2);
  poses.nearest = range[0];
  poses.farthest = range[1];
  if (!(poses.nearest > 0 && poses.farthest >= poses.nearest)) {
    distance.Fail("expected [nearest, farthest] in metres");
  }
  if (node.Has("rate") && !poses.moving) node.At("rate").Fail("goes with 'kind: moving'");
  ReadNumber(node, "rate", 0.1, 1e5, &poses.rate);
  ReadNumber(node, "tilt", 0, 1.4, &poses.tilt);
  ReadNumber(node, "roll", 0, std::numbers::pi, &poses.roll);
  ReadNumber(node, "partial", 0, 1, &poses.partial);
  if (node.Has("aim")) {
    const std::string name = node.At("aim").AsString();
    const std::vector<std::string_view> names = NamesOf(cameras);
    const auto found = std::find(names.begin(), names.end(), name);
    if (found == names.end() && name == "all") {
      poses.aim_all = true;
      return poses;
    }
    if (found == names.end()) {
      node.At("aim").Fail(fmt::format("no camera is named '{}'{}", name, SuggestName(name, names)));
    }
    poses.aim = static_cast<size_t>(found - names.begin());
  }
  return poses;
}

// A file, or {target, T_target_own} of another target than the first.
TargetSpec ReadTargetSpec(const std::string& name,
                          const YamlNode& node,
                          const std::filesystem::path& spec) {
  CheckCameraName(name, node);  // it becomes part of file names too
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
    spec->target = PathBeside(spec->path, root.At("target"));
  }
  if (root.Has("target_error")) {
    spec->target_error = 0;
    ReadNumber(root, "target_error", 0, 1, &*spec->target_error);
  }
  if (root.Has("rigid_tags")) spec->rigid_tags = root.At("rigid_tags").AsBool();
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

CalibratedCamera TrueCamera(const CameraSpec& camera) {
  const auto count = static_cast<Eigen::Index>(camera.params.size());
  return {.name = camera.name,
          .model = camera.model,
          .image_size = camera.image_size,
          .config = camera.config,
          .params = camera.params,
          .covariance = Eigen::MatrixXd::Zero(count, count),
          .T_camera_rig = camera.T_camera_rig};
}

SimulationSpec ReadSimulationSpec(const std::filesystem::path& path,
                                  std::span<const CameraModel> models) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  root.CheckKeys({"plenocal",
                  "seed",
                  "target",
                  "targets",
                  "target_error",
                  "rigid_tags",
                  "cameras",
                  "poses",
                  "wall",
                  "exposures",
                  "scene",
                  "trajectory",
                  "calibration_sigma",
                  "white_images"});
  SimulationSpec spec;
  spec.path = path;
  ReadInteger(root, "seed", 0, std::numeric_limits<int>::max(), &spec.seed);
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
  ReadInteger(root, "white_images", 1, 1000, &spec.white_images);
  return spec;
}

}  // namespace plenocal::simulate
