// SPDX-License-Identifier: Apache-2.0
#include "calib/files/session.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>

#include "calib/base/error.h"
#include "calib/base/names.h"
#include "calib/files/calibration_file.h"
#include "calib/files/checks/transform_keys.h"
#include "calib/files/image_keys.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

// Index of the parameter that `name` stands for; fails at `node` when there is none.
size_t IndexOfParam(const CameraModel& model, const std::string& name, const YamlNode& node) {
  const auto found = std::ranges::find(model.params, name, &Param::name);
  if (found != model.params.end()) return static_cast<size_t>(found - model.params.begin());
  const std::string nearest = SuggestName(name, NamesOf(model.params));
  node.Fail(fmt::format("'{}' is no parameter of model {}{}", name, model.name, nearest));
}

// Keys about the parameters of a model.
constexpr const char* kModelKeys = "initial fixed prior bounds equal shared prior_from free from";

void RefuseModelKeys(const YamlNode& node) {
  for (const std::string_view key : Words(kModelKeys)) {
    const auto value = node.Find(key);
    if (value) value->Fail("is about one camera model; state it in place of 'model: auto'");
  }
}

void CheckCameraKeys(const YamlNode& node, const CameraModel& model) {
  std::vector<std::string_view> known =
      Words("model images topic white_images detections times image_size image_circle bayer");
  for (const std::string_view key : Words(kModelKeys)) known.push_back(key);
  for (const Param& config : model.config) known.push_back(config.name);
  for (const auto& [key, value] : node.Entries()) {
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      value.Fail(fmt::format("unknown key{}", SuggestName(key, known)));
    }
  }
}

// All keys that the camera lacks are named together.
void RequireCameraKeys(const YamlNode& node, const CameraModel* model) {
  std::vector<std::string_view> required{"model"};
  std::string example = "model: pinhole-radtan\nimages: images/*.png\n";
  for (const Param& config : model != nullptr ? model->config : std::span<const Param>()) {
    required.push_back(config.name);
    example += fmt::format("{}: {}\n", config.name, config.unit == "m" ? "5.5 um" : "1");
  }
  const bool source = node.Has("images") || node.Has("detections");
  const bool others = std::ranges::all_of(required, [&](auto key) { return node.Has(key); });
  if (!source && !others) required.push_back("images");
  node.RequireKeys(required, example);
}

// A path, or {file, format} of another tool's file.
EarlierFile ReadEarlierFile(const YamlNode& node, const std::filesystem::path& session) {
  EarlierFile file;
  if (node.IsMap()) {
    node.CheckKeys({"file", "format"});
    static constexpr std::array<std::string_view, 2> kRequired{"file", "format"};
    node.RequireKeys(kRequired, "file: camchain.yaml\nformat: kalibr\n");
    file.format = node.At("format").AsString();
  }
  const YamlNode path = node.IsMap() ? node.At("file") : node;
  file.path = PathBeside(session, path);
  if (!IsThere(file.path)) {
    path.Fail(fmt::format("{}: no such file", file.path.string()));
  }
  return file;
}

// Reads a camera's keys about the earlier calibration of the session.
void ReadEarlierParams(const YamlNode& node, bool has_from, SessionCamera* camera) {
  for (const char* key : {"prior_from", "free"}) {
    if (!node.Has(key)) continue;
    const YamlNode list = node.At(key);
    if (!has_from) {
      list.Fail("refers to an earlier calibration; give it: 'from: earlier/calibration.yaml'");
    }
    const bool is_free = std::string_view(key) == "free";
    std::vector<size_t>& params = is_free ? camera->earlier.free : camera->earlier.prior.emplace();
    for (const YamlNode& element : list.Elements()) {
      if (is_free && element.AsString() == "extrinsics") {
        camera->earlier.free_extrinsics = true;
      } else {
        params.push_back(IndexOfParam(*camera->model, element.AsString(), element));
      }
    }
  }
}

SessionCamera ReadCamera(const std::string& name,
                         const YamlNode& node,
                         const Session& session_so_far,
                         std::span<const CameraModel> models) {
  const std::filesystem::path& session = session_so_far.path;
  SessionCamera camera;
  camera.name = name;
  CheckName(name, node);
  if (!node.Has("model")) RequireCameraKeys(node, nullptr);
  camera.auto_model = node.At("model").AsString() == kAuto;
  camera.model =
      camera.auto_model ? FindModel(models, kUsualModel) : ReadModel(node.At("model"), models);
  const CameraModel& model = *camera.model;
  CheckCameraKeys(node, model);
  if (camera.auto_model) RefuseModelKeys(node);
  RequireCameraKeys(node, &model);

  if (node.Has("images") == node.Has("detections")) {
    node.Fail("give either 'images' (a glob, a folder or a list) or 'detections' (a CSV file)");
  }
  if (node.Has("images")) camera.images = ReadImagePatterns(session, node);
  if (node.Has("detections")) camera.detections = PathBeside(session, node.At("detections"));
  if (node.Has("times")) camera.times = PathBeside(session, node.At("times"));
  if (node.Has("white_images")) camera.white_images = PathsBeside(session, node.At("white_images"));
  if (node.Has("bayer")) camera.bayer = ReadBayerOrder(node.At("bayer"));
  if (node.Has("image_size")) {
    camera.image_size = ReadImageSize(node.At("image_size"));
  } else if (node.Has("detections")) {
    node.Fail("a camera given by 'detections' needs 'image_size: [width, height]'");
  }
  if (node.Has("image_circle")) camera.image_circle = ReadImageCircle(node.At("image_circle"));
  for (const Param& config : model.config) {
    camera.config.push_back(ReadWithin(node.At(config.name), config));
  }

  if (node.Has("from")) camera.from = ReadEarlierFile(node.At("from"), session);
  const bool has_from = !camera.from.path.empty() || !session_so_far.from.path.empty();
  ReadEarlierParams(node, has_from, &camera);

  camera.initial.resize(model.params.size());
  if (node.Has("initial")) {
    for (const auto& [param, value] : node.At("initial").Entries()) {
      const size_t index = IndexOfParam(model, param, value);
      camera.initial[index] = ReadWithin(value, model.params[index]);
    }
  }
  camera.fixed.resize(model.params.size(), false);
  if (node.Has("fixed")) {
    for (const YamlNode& element : node.At("fixed").Elements()) {
      const size_t index = IndexOfParam(model, element.AsString(), element);
      if (!camera.initial[index] && !has_from) {
        camera.initial[index] = model.params[index].neutral;
      }
      if (!camera.initial[index] && !has_from) {
        element.Fail(fmt::format("'{}' is to be fixed, but 'initial' gives no value for it",
                                 element.AsString()));
      }
      camera.fixed[index] = true;
    }
  }
  return camera;
}

void ReadPriors(const YamlNode& node, SessionCamera* camera) {
  for (const auto& [name, prior] : node.Entries()) {
    const size_t k = IndexOfParam(*camera->model, name, prior);
    static constexpr std::array<std::string_view, 2> kKeys{"value", "sigma"};
    prior.CheckKeys(kKeys);
    prior.RequireKeys(kKeys, "value: 805\nsigma: 2\n");
    if (camera->fixed[k])
      prior.Fail(fmt::format("'{}' is fixed; remove it here or from 'fixed'", name));
    camera->rules[k].prior = {ReadWithin(prior.At("value"), camera->model->params[k]),
                              prior.At("sigma").AsPositive()};
  }
}

void ReadBounds(const YamlNode& node, SessionCamera* camera) {
  for (const auto& [name, bounds] : node.Entries()) {
    const size_t k = IndexOfParam(*camera->model, name, bounds);
    const auto elements = bounds.Elements();
    if (elements.size() != 2) bounds.Fail("expected [lowest, highest]");
    ParamRule& rule = camera->rules[k];
    rule.lower = ReadWithin(elements[0], camera->model->params[k]);
    rule.upper = ReadWithin(elements[1], camera->model->params[k]);
    if (!(rule.lower < rule.upper))
      bounds.Fail("expected the lowest value first, then the highest");
    if (camera->fixed[k])
      bounds.Fail(fmt::format("'{}' is fixed; remove it here or from 'fixed'", name));
    const auto check = [&rule, &name = name, &bounds = bounds](const char* what,
                                                               std::optional<double> value) {
      if (!value || (*value >= rule.lower && *value <= rule.upper)) return;
      bounds.Fail(fmt::format(
          "{} of '{}', {:g}, is outside [{:g}, {:g}]", what, name, *value, rule.lower, rule.upper));
    };
    check("the value in 'initial'", camera->initial[k]);
    if (rule.prior) check("the prior's value", rule.prior->value);
  }
}

// Ties a parameter to another, which takes over what the session gives for it.
void Tie(const YamlNode& node,
         ParamIndex from,
         ParamIndex to,
         std::vector<SessionCamera>* cameras) {
  SessionCamera& camera = (*cameras)[from.camera];
  SessionCamera& other = (*cameras)[to.camera];
  const Param& param = camera.model->params[from.param];
  const Param& root = other.model->params[to.param];
  const std::string root_name = from.camera == to.camera
                                    ? std::string(root.name)
                                    : fmt::format("{}.{}", other.name, root.name);
  if (param.unit != root.unit) {
    node.Fail(fmt::format("'{}' ({}) and '{}' ({}) have different units",
                          param.name,
                          param.unit,
                          root_name,
                          root.unit));
  }
  ParamRule& rule = camera.rules[from.param];
  if (rule.tied_to) node.Fail(fmt::format("'{}' is tied to another parameter already", param.name));
  if (rule.prior || rule.lower != ParamRule().lower) {
    node.Fail(fmt::format(
        "'{}' has no value of its own; give prior and bounds to '{}'", param.name, root_name));
  }
  std::optional<double>& start = camera.initial[from.param];
  std::optional<double>& root_start = other.initial[to.param];
  if (start && root_start && *start != *root_start) {
    node.Fail(
        fmt::format("'initial' of '{}' is {:g}, but that of '{}', to which it is tied, is {:g}",
                    param.name,
                    *start,
                    root_name,
                    *root_start));
  }
  if (!root_start) root_start = start;
  if (camera.fixed[from.param]) other.fixed[to.param] = true;
  rule.tied_to = to;
}

void ReadEqual(const YamlNode& node, size_t c, std::vector<SessionCamera>* cameras) {
  const CameraModel& model = *(*cameras)[c].model;
  for (const YamlNode& group : node.Elements()) {
    const auto names = group.Elements();
    if (names.size() < 2) group.Fail("expected two parameters or more: [f_x, f_y]");
    const size_t root = IndexOfParam(model, names[0].AsString(), names[0]);
    for (size_t i = 1; i < names.size(); ++i) {
      const size_t k = IndexOfParam(model, names[i].AsString(), names[i]);
      if (k == root) names[i].Fail("named twice");
      Tie(names[i], {c, k}, {c, root}, cameras);
    }
  }
}

void ReadShared(const YamlNode& node, size_t c, std::vector<SessionCamera>* cameras) {
  const std::vector<std::string_view> names = NamesOf(*cameras);
  for (const auto& [name, value] : node.Entries()) {
    const size_t k = IndexOfParam(*(*cameras)[c].model, name, value);
    const std::string other = value.AsString();
    const auto found = std::find(names.begin(), names.end(), other);
    if (found == names.end() || other == (*cameras)[c].name) {
      std::vector<std::string_view> others = names;
      std::erase(others, (*cameras)[c].name);
      value.Fail(fmt::format("expected another camera of this session, found '{}'{}",
                             other,
                             SuggestName(other, others)));
    }
    const auto place = static_cast<size_t>(found - names.begin());
    if ((*cameras)[place].auto_model) {
      value.Fail(fmt::format("the model of '{}' is auto; state it", other));
    }
    Tie(value, {c, k}, {place, IndexOfParam(*(*cameras)[place].model, name, value)}, cameras);
  }
}

// Reads the keys about parameters beside start values.
void ReadRules(const YamlNode& cameras_node, std::vector<SessionCamera>* cameras) {
  const auto nodes = cameras_node.Entries();
  for (size_t c = 0; c < nodes.size(); ++c) {
    const YamlNode& node = nodes[c].second;
    SessionCamera& camera = (*cameras)[c];
    camera.rules.resize(camera.model->params.size());
    if (node.Has("prior")) ReadPriors(node.At("prior"), &camera);
    if (node.Has("bounds")) ReadBounds(node.At("bounds"), &camera);
  }
  for (size_t c = 0; c < nodes.size(); ++c) {
    const YamlNode& node = nodes[c].second;
    if (node.Has("equal")) ReadEqual(node.At("equal"), c, cameras);
    if (node.Has("shared")) ReadShared(node.At("shared"), c, cameras);
  }
  for (size_t c = 0; c < nodes.size(); ++c) {
    SessionCamera& camera = (*cameras)[c];
    for (size_t k = 0; k < camera.rules.size(); ++k) {
      auto& tied_to = camera.rules[k].tied_to;
      if (!tied_to) continue;
      // The parameter at the end of a chain of ties.
      for (size_t steps = 0;; ++steps) {
        const auto& next = (*cameras)[tied_to->camera].rules[tied_to->param].tied_to;
        if (!next) break;
        if (steps > nodes.size() || *next == ParamIndex{c, k}) {
          nodes[c].second.At("shared").Fail(
              fmt::format("'{}' would be tied to itself; share it in one direction",
                          camera.model->params[k].name));
        }
        tied_to = *next;
      }
      camera.initial[k] = (*cameras)[tied_to->camera].initial[tied_to->param];
      camera.fixed[k] = (*cameras)[tied_to->camera].fixed[tied_to->param];
    }
  }
  const bool none = std::ranges::none_of(nodes, [](const auto& entry) {
    const YamlNode& node = entry.second;
    return node.Has("prior") || node.Has("bounds") || node.Has("equal") || node.Has("shared");
  });
  for (SessionCamera& camera : *cameras) {
    if (none) camera.rules.clear();
  }
}

// A word such as chessboard:9x6:25mm, unless a file is called so.
bool IsWord(const std::string& text, const std::filesystem::path& file) {
  const size_t colon = text.find(':');
  const bool begins = colon != std::string::npos && colon > 0 &&
                      text.find_first_not_of("abcdefghijklmnopqrstuvwxyz") == colon;
  return begins && !IsThere(file);
}

TargetSource ReadTargetSource(const YamlNode& node, const std::filesystem::path& session) {
  TargetSource source;
  if (node.IsMap()) {
    source.keys = node;
    return source;
  }
  const std::filesystem::path file = PathBeside(session, node);
  if (IsWord(node.AsString(), file)) {
    source.keys = node;
  } else {
    source.file = file;
  }
  return source;
}

// A target, or {target, pose}.
SessionTarget ReadSessionTarget(const std::string& name,
                                const YamlNode& node,
                                const std::filesystem::path& session) {
  SessionTarget target{.name = name, .source = {}, .moves = false, .known = {}};
  CheckName(name, node);  // it becomes part of file names too
  if (!node.IsMap() || !node.Has("target")) {
    target.source = ReadTargetSource(node, session);
    return target;
  }
  node.CheckKeys({"target", "pose"});
  target.source = ReadTargetSource(node.At("target"), session);
  if (!node.Has("pose")) return target;
  const YamlNode pose = node.At("pose");
  if (pose.IsSequence()) {
    target.known = ReadTransform(pose);
    return target;
  }
  static constexpr std::array<std::string_view, 2> kPoses{"fixed", "free"};
  const std::string word = pose.AsString();
  if (std::ranges::find(kPoses, word) == kPoses.end()) {
    pose.Fail(
        fmt::format("expected 'fixed' (it stays where it is, the pose is estimated), 'free' "
                    "(it moves by itself) or a 4 x 4 matrix, its frame to that of the first "
                    "target{}",
                    SuggestName(word, kPoses)));
  }
  target.moves = word == "free";
  return target;
}

void ReadTargets(const YamlNode& node, Session* session) {
  for (const auto& [name, entry] : node.Entries()) {
    session->targets.push_back(ReadSessionTarget(name, entry, session->path));
  }
  std::vector<SessionTarget>& targets = session->targets;
  if (targets.empty()) node.Fail("expected targets: 'floor: floor.yaml'");
  SessionTarget& first = targets.front();
  const bool any_known =
      std::ranges::any_of(targets, [](const auto& target) { return target.known.has_value(); });
  if (first.known)
    node.Entries()[0].second.Fail(
        "poses are given in the frame of this first target; give it none");
  if (any_known && first.moves) {
    node.Entries()[0].second.Fail(
        "poses of others are given in the frame of this target, which moves; name another first");
  }
  if (any_known) first.known = RigidTransform{};
  session->target = first.source;
  if (targets.size() == 1) targets.clear();
}

ExcludeRule ReadExcludeRule(const YamlNode& node, const std::vector<SessionCamera>& cameras) {
  node.CheckKeys({"camera", "frame", "markers", "note"});
  ExcludeRule rule;
  if (!node.Has("frame") && !node.Has("markers")) {
    node.Fail("expected 'frame' (a name or glob), 'markers' (a list of numbers) or both");
  }
  if (node.Has("camera")) {
    rule.camera = node.At("camera").AsString();
    const auto names = NamesOf(cameras);
    if (std::ranges::find(names, rule.camera) == names.end()) {
      node.At("camera").Fail(fmt::format("expected a camera of this session, got '{}'{}",
                                         rule.camera,
                                         SuggestName(rule.camera, names)));
    }
  }
  if (node.Has("frame")) rule.frame = node.At("frame").AsString();
  if (const auto markers = node.Find("markers")) {
    for (const YamlNode& marker : markers->Elements()) rule.markers.push_back(marker.AsInteger());
    if (rule.markers.empty()) markers->Fail("expected marker numbers, got an empty list");
  }
  if (node.Has("note")) rule.note = node.At("note").AsString();
  return rule;
}

void ReadOptions(const YamlNode& options, Session* session) {
  options.CheckKeys({"refine_target", "loss", "frames"});
  if (const auto frames = options.Find("frames")) {
    session->all_frames = frames->AsString() == "all";
    if (!session->all_frames) {
      const int most = frames->AsInteger();
      if (most < 1) frames->Fail("expected a number of frames, 1 or more, or all");
      session->frames = static_cast<size_t>(most);
    }
  }
  if (const auto refine = options.Find("refine_target")) {
    session->auto_refine = refine->IsScalar() && refine->AsString() == kAuto;
    if (!session->auto_refine) session->refine_target = refine->AsBool();
  }
  if (!options.Has("loss")) return;
  static constexpr std::array<std::string_view, 3> kNames{"huber", "cauchy", "none"};
  static constexpr std::array kLosses{Loss::kHuber, Loss::kCauchy, Loss::kNone};
  const YamlNode node = options.At("loss");
  const std::string name = node.AsString();
  const auto found = std::ranges::find(kNames, name);
  if (found == kNames.end()) {
    node.Fail(fmt::format("unknown loss '{}'{}", name, SuggestName(name, kNames)));
  }
  session->loss = kLosses[static_cast<size_t>(found - kNames.begin())];
}

// The target, or the scene in its place, with the calibration that comes before.
void ReadTargetOrScene(const YamlNode& root, const std::filesystem::path& path, Session* session) {
  if (root.Has("from")) session->from = ReadEarlierFile(root.At("from"), path);
  if (root.Has("extrinsics_only")) {
    session->extrinsics_only = root.At("extrinsics_only").AsBool();
  }
  const auto scene = root.Find("scene"), target = root.Find("target"),
             targets = root.Find("targets");
  if (scene) {
    if (target || targets) {
      scene->Fail("a session has either 'target' or 'scene'; remove one of them");
    }
    session->scene = ReadSceneKeys(*scene);
  } else if (targets) {
    if (target) targets->Fail("give either this or 'target'");
    ReadTargets(*targets, session);
  } else {
    session->target = ReadTargetSource(root.At("target"), path);
  }
}

// A choice by held-out frames needs one target, and no earlier calibration.
void CheckAuto(const YamlNode& root, const Session& session) {
  const char* const without = session.scene                ? "'scene'"
                              : !session.targets.empty()   ? "several 'targets'"
                              : !session.from.path.empty() ? "'from'"
                                                           : nullptr;
  if (without == nullptr) return;
  for (const SessionCamera& camera : session.cameras) {
    if (!camera.auto_model) continue;
    root.At("cameras")
        .At(camera.name)
        .At("model")
        .Fail(fmt::format("state a model; with {} none is chosen", without));
  }
  if (!session.auto_refine) return;
  root.At("options")
      .At("refine_target")
      .Fail(fmt::format("state true or false; with {} none is chosen", without));
}

// `extrinsics_only` needs the parameters of every camera.
void CheckExtrinsicsOnly(const YamlNode& root, const Session& session) {
  if (!session.extrinsics_only) return;
  for (const SessionCamera& camera : session.cameras) {
    if (!camera.from.path.empty() || !session.from.path.empty()) continue;
    root.At("extrinsics_only")
        .Fail(
            fmt::format("{} has no earlier calibration; give it: 'from: earlier/calibration.yaml'",
                        camera.name));
  }
}

Session ReadRoot(const YamlNode& root,
                 const std::filesystem::path& path,
                 std::span<const CameraModel> models) {
  root.CheckVersion();
  root.CheckKeys(
      Words("plenocal target targets scene from extrinsics_only cameras options exclude pairing "
            "plugins models distances"));
  static constexpr std::array<std::string_view, 2> kRequired{"target", "cameras"};
  const bool has_scene = root.Has("scene") || root.Has("targets");
  root.RequireKeys(
      has_scene ? std::span(kRequired).subspan(1) : std::span(kRequired),
      has_scene
          ? "cameras: {cam: {model: pinhole-radtan, images: images/*.png}}\n"
          : "target: target.yaml\ncameras: {cam: {model: pinhole-radtan, images: images/*.png}}\n");

  Session session;
  session.path = path;
  ReadTargetOrScene(root, path, &session);
  if (const auto distances = root.Find("distances")) {
    if (session.scene) distances->Fail("belongs to 'scene' here; move it there");
    session.distances = ReadTargetDistances(*distances, NamesOf(session.targets));
  }
  for (const auto& [name, node] : root.At("cameras").Entries()) {
    session.cameras.push_back(ReadCamera(name, node, session, models));
  }
  CheckExtrinsicsOnly(root, session);
  if (session.cameras.empty()) root.At("cameras").Fail("expected at least one camera");
  ReadRules(root.At("cameras"), &session.cameras);
  for (const SessionTarget& target : session.targets) {
    const auto names = NamesOf(session.cameras);
    if (std::ranges::find(names, target.name) == names.end()) continue;
    root.At("targets").At(target.name).Fail("is the name of a camera too; rename one of them");
  }
  if (root.Has("options")) ReadOptions(root.At("options"), &session);
  CheckAuto(root, session);
  if (root.Has("pairing")) session.pairing = ReadPairing(root.At("pairing"));
  if (const auto rules = root.Find("exclude")) {
    for (const YamlNode& rule : rules->Elements()) {
      session.exclude.push_back(ReadExcludeRule(rule, session.cameras));
    }
  }
  return session;
}

}  // namespace

void AddExcludeRules(const std::vector<std::string>& rules, Session* session) {
  if (rules.empty()) return;
  // A second block of the same name would be no YAML.
  const bool has_block = !session->exclude.empty();
  session->text += has_block ? "# excluded by the command line as well:\n" : "exclude:\n";
  for (const std::string& rule : rules) {
    const YamlNode node = YamlNode::Parse("{" + rule + "}", fmt::format("--exclude \"{}\"", rule));
    session->exclude.push_back(ReadExcludeRule(node, session->cameras));
    session->text += fmt::format("{}  - {{{}}}\n", has_block ? "#" : "", rule);
  }
}

std::string TargetSource::Text() const {
  if (keys) return keys->Dump();
  std::error_code error;
  return std::filesystem::is_regular_file(file, error) ? ReadTextFile(file) : std::string();
}

std::vector<std::filesystem::path> ReadSessionPlugins(const std::filesystem::path& path) {
  std::vector<std::filesystem::path> plugins;
  const YamlNode root = YamlNode::ReadFile(path);
  if (!root.Has("plugins")) return plugins;
  for (const YamlNode& node : root.At("plugins").Elements()) {
    plugins.push_back(std::filesystem::absolute(PathBeside(path, node)));
    if (!IsThere(plugins.back())) {
      node.Fail(fmt::format("{}: no such file; check the path of the shared library",
                            plugins.back().string()));
    }
  }
  return plugins;
}

Session ReadSession(const std::filesystem::path& path, std::span<const CameraModel> models) {
  Session session = ReadRoot(YamlNode::ReadFile(path), path, models);
  session.text = ReadTextFile(path);
  return session;
}

Session ParseSession(const std::string& text,
                     const std::filesystem::path& path,
                     std::span<const CameraModel> models) {
  Session session = ReadRoot(YamlNode::Parse(text, path.string()), path, models);
  session.text = text;
  return session;
}

}  // namespace plenocal
