// SPDX-License-Identifier: Apache-2.0
#include "calib/session.h"

#include <fmt/format.h>
#include <fnmatch.h>
#include <glob.h>

#include <algorithm>
#include <map>
#include <optional>

#include "calib/camera_yaml.h"
#include "calib/error.h"
#include "calib/names.h"
#include "calib/yaml.h"

namespace plenocal {
namespace {

// Index of the parameter that `name` stands for; fails at `node` when there is none.
size_t ParamIndex(const CameraModel& model, const std::string& name, const YamlNode& node) {
  std::vector<std::string_view> names;
  for (size_t i = 0; i < model.params.size(); ++i) {
    if (model.params[i].name == name) return i;
    names.push_back(model.params[i].name);
  }
  node.Fail(fmt::format(
      "'{}' is no parameter of model {}{}", name, model.name, SuggestName(name, names)));
}

std::string PathBeside(const std::filesystem::path& session, const YamlNode& node) {
  const std::string text = node.AsString();
  if (text.empty()) node.Fail("expected a path, found nothing");
  return (session.parent_path() / text).string();
}

void CheckCameraKeys(const YamlNode& node, const CameraModel& model) {
  std::vector<std::string_view> known{"model",
                                      "images",
                                      "white_images",
                                      "detections",
                                      "image_size",
                                      "bayer",
                                      "initial",
                                      "fixed",
                                      "prior",
                                      "bounds",
                                      "equal",
                                      "shared"};
  for (const Param& config : model.config) known.push_back(config.name);
  for (const auto& [key, value] : node.Entries()) {
    if (std::find(known.begin(), known.end(), key) == known.end()) {
      value.Fail(fmt::format("unknown key{}", SuggestName(key, known)));
    }
  }
}

SessionCamera ReadCamera(const std::string& name,
                         const YamlNode& node,
                         const std::filesystem::path& session,
                         std::span<const CameraModel> models) {
  SessionCamera camera;
  camera.name = name;
  if (name.empty() || name.find_first_of("/\\,\n\r\t ") != std::string::npos) {
    node.Fail("a camera's name becomes part of file names; use letters, digits, '_' and '-'");
  }
  camera.model = ReadModel(node.At("model"), models);
  const CameraModel& model = *camera.model;
  CheckCameraKeys(node, model);

  if (node.Has("images") == node.Has("detections")) {
    node.Fail("give either 'images' (a glob) or 'detections' (a CSV file)");
  }
  if (node.Has("images")) camera.images = PathBeside(session, node.At("images"));
  if (node.Has("detections")) camera.detections = PathBeside(session, node.At("detections"));
  if (node.Has("white_images")) camera.white_images = PathBeside(session, node.At("white_images"));
  if (node.Has("bayer")) {
    camera.bayer = node.At("bayer").AsString();
    static constexpr std::array<std::string_view, 4> kOrders{"RGGB", "BGGR", "GRBG", "GBRG"};
    if (std::find(kOrders.begin(), kOrders.end(), camera.bayer) == kOrders.end()) {
      node.At("bayer").Fail(
          fmt::format("expected the colours of the top-left 2 x 2 pixels, found '{}'{}",
                      camera.bayer,
                      SuggestName(camera.bayer, kOrders)));
    }
  }
  if (node.Has("image_size")) {
    camera.image_size = ReadImageSize(node.At("image_size"));
  } else if (node.Has("detections")) {
    node.Fail("a camera given by 'detections' needs 'image_size: [width, height]'");
  }
  for (const Param& config : model.config) {
    camera.config.push_back(ReadWithin(node.At(config.name), config));
  }

  camera.initial.resize(model.params.size());
  if (node.Has("initial")) {
    for (const auto& [param, value] : node.At("initial").Entries()) {
      const size_t index = ParamIndex(model, param, value);
      camera.initial[index] = ReadWithin(value, model.params[index]);
    }
  }
  camera.fixed.resize(model.params.size(), false);
  if (node.Has("fixed")) {
    for (const YamlNode& element : node.At("fixed").Elements()) {
      const size_t index = ParamIndex(model, element.AsString(), element);
      if (!camera.initial[index]) camera.initial[index] = model.params[index].neutral;
      if (!camera.initial[index]) {
        element.Fail(fmt::format("'{}' is to be held, but 'initial' gives no value for it",
                                 element.AsString()));
      }
      camera.fixed[index] = true;
    }
  }
  return camera;
}

void ReadPriors(const YamlNode& node, SessionCamera* camera) {
  for (const auto& [name, prior] : node.Entries()) {
    const size_t k = ParamIndex(*camera->model, name, prior);
    prior.CheckKeys({"value", "sigma"});
    if (camera->fixed[k]) prior.Fail(fmt::format("'{}' is held ('fixed')", name));
    camera->rules[k].prior = {ReadWithin(prior.At("value"), camera->model->params[k]),
                              prior.At("sigma").AsPositive()};
  }
}

void ReadBounds(const YamlNode& node, SessionCamera* camera) {
  for (const auto& [name, bounds] : node.Entries()) {
    const size_t k = ParamIndex(*camera->model, name, bounds);
    const auto elements = bounds.Elements();
    if (elements.size() != 2) bounds.Fail("expected [lowest, highest]");
    ParamRule& rule = camera->rules[k];
    rule.lower = ReadWithin(elements[0], camera->model->params[k]);
    rule.upper = ReadWithin(elements[1], camera->model->params[k]);
    if (!(rule.lower < rule.upper))
      bounds.Fail("expected the lowest value first, then the highest");
    if (camera->fixed[k]) bounds.Fail(fmt::format("'{}' is held ('fixed')", name));
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

// Makes a parameter one with another, which has what the session says of both.
void Tie(const YamlNode& node,
         ParamPlace from,
         ParamPlace to,
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
  if (rule.same_as)
    node.Fail(fmt::format("'{}' is one with another parameter already", param.name));
  if (rule.prior || rule.lower != ParamRule().lower) {
    node.Fail(fmt::format(
        "'{}' has no value of its own; give prior and bounds to '{}'", param.name, root_name));
  }
  std::optional<double>& start = camera.initial[from.param];
  std::optional<double>& root_start = other.initial[to.param];
  if (start && root_start && *start != *root_start) {
    node.Fail(fmt::format("'{}' starts at {:g}, but '{}', with which it is one, at {:g}",
                          param.name,
                          *start,
                          root_name,
                          *root_start));
  }
  if (!root_start) root_start = start;
  if (camera.fixed[from.param]) other.fixed[to.param] = true;
  rule.same_as = to;
}

void ReadEqual(const YamlNode& node, size_t c, std::vector<SessionCamera>* cameras) {
  const CameraModel& model = *(*cameras)[c].model;
  for (const YamlNode& group : node.Elements()) {
    const auto names = group.Elements();
    if (names.size() < 2) group.Fail("expected two parameters or more: [f_x, f_y]");
    const size_t root = ParamIndex(model, names[0].AsString(), names[0]);
    for (size_t i = 1; i < names.size(); ++i) {
      const size_t k = ParamIndex(model, names[i].AsString(), names[i]);
      if (k == root) names[i].Fail("named twice");
      Tie(names[i], {c, k}, {c, root}, cameras);
    }
  }
}

void ReadShared(const YamlNode& node, size_t c, std::vector<SessionCamera>* cameras) {
  const std::vector<std::string_view> names = NamesOf(*cameras);
  for (const auto& [name, value] : node.Entries()) {
    const size_t k = ParamIndex(*(*cameras)[c].model, name, value);
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
    Tie(value, {c, k}, {place, ParamIndex(*(*cameras)[place].model, name, value)}, cameras);
  }
}

// What the session says of parameters beside start values.
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
      auto& same_as = camera.rules[k].same_as;
      if (!same_as) continue;
      // The end of the chain.
      for (size_t steps = 0;; ++steps) {
        const auto& next = (*cameras)[same_as->camera].rules[same_as->param].same_as;
        if (!next) break;
        if (steps > nodes.size() || *next == ParamPlace{c, k}) {
          nodes[c].second.At("shared").Fail(
              fmt::format("'{}' would be one with itself; share it in one direction",
                          camera.model->params[k].name));
        }
        same_as = *next;
      }
      camera.initial[k] = (*cameras)[same_as->camera].initial[same_as->param];
      camera.fixed[k] = (*cameras)[same_as->camera].fixed[same_as->param];
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

// What the last `*` of a pattern stands for in a path that matches it: of `*_*.png` and a_b_01.png
// it is 01, since the stars before it take all they can. Nothing for a pattern without `*`.
std::optional<std::string> LastStar(const std::string& text, const std::string& pattern) {
  const size_t star = pattern.rfind('*');
  if (star == std::string::npos) return std::nullopt;
  const std::string before = pattern.substr(0, star), after = pattern.substr(star + 1);
  const auto matches = [](const std::string& part, const std::string& text_part) {
    return fnmatch(part.c_str(), text_part.c_str(), FNM_PATHNAME) == 0;
  };
  for (size_t begin = text.size() + 1; begin-- > 0;) {
    if (!matches(before, text.substr(0, begin))) continue;
    for (size_t end = text.size() + 1; end-- > begin;) {
      const std::string name = text.substr(begin, end - begin);
      if (name.find('/') == std::string::npos && matches(after, text.substr(end))) return name;
    }
  }
  return std::nullopt;
}

}  // namespace

Session ReadSession(const std::filesystem::path& path, std::span<const CameraModel> models) {
  const YamlNode root = YamlNode::ReadFile(path);
  root.CheckVersion();
  root.CheckKeys({"plenocal", "target", "cameras", "options"});

  Session session;
  session.path = path;
  session.target = PathBeside(path, root.At("target"));
  for (const auto& [name, node] : root.At("cameras").Entries()) {
    session.cameras.push_back(ReadCamera(name, node, path, models));
  }
  if (session.cameras.empty()) root.At("cameras").Fail("expected at least one camera");
  ReadRules(root.At("cameras"), &session.cameras);

  if (root.Has("options")) {
    const YamlNode options = root.At("options");
    options.CheckKeys({"refine_target", "loss"});
    if (options.Has("refine_target")) session.refine_target = options.At("refine_target").AsBool();
    if (options.Has("loss")) {
      static const std::map<std::string, Loss> kLosses{
          {"none", Loss::kNone}, {"huber", Loss::kHuber}, {"cauchy", Loss::kCauchy}};
      const YamlNode node = options.At("loss");
      const auto found = kLosses.find(node.AsString());
      if (found == kLosses.end()) {
        static constexpr std::array<std::string_view, 3> kNames{"huber", "cauchy", "none"};
        node.Fail(fmt::format(
            "unknown loss '{}'{}", node.AsString(), SuggestName(node.AsString(), kNames)));
      }
      session.loss = found->second;
    }
  }
  return session;
}

std::vector<FrameImage> ExpandImages(const std::string& pattern, const std::string& what) {
  glob_t found{};
  const int status = glob(pattern.c_str(), 0, nullptr, &found);
  std::vector<FrameImage> images;
  for (size_t i = 0; i < found.gl_pathc; ++i) images.push_back({"", found.gl_pathv[i]});
  globfree(&found);
  if (status != 0 || images.empty()) {
    throw Error(
        ErrorKind::kInput,
        fmt::format("{}: no file matches '{}'; check the path (it is relative to the session "
                    "file) and the pattern",
                    what,
                    pattern));
  }

  std::map<std::string, std::filesystem::path> frames;
  for (FrameImage& image : images) {
    const std::string text = image.path.string();
    image.frame = LastStar(text, pattern).value_or(image.path.stem().string());
    const auto [place, is_new] = frames.emplace(image.frame, image.path);
    if (!is_new) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: {} and {} both belong to frame '{}' (what the last '*' of '{}' "
                              "stands for); use a pattern that tells them apart",
                              what,
                              place->second.string(),
                              text,
                              image.frame,
                              pattern));
    }
  }
  return images;
}

}  // namespace plenocal
