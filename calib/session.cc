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
  std::vector<std::string_view> known{
      "model", "images", "white_images", "detections", "image_size", "initial", "fixed", "bayer"};
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
