// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/recorded_topics.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <memory>
#include <set>

#include "calib/base/format_error.h"
#include "engine/recording/stores/message_log.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

/// Parts of topics that name the form of an image and not its camera.
bool NamesForm(const std::string& part) {
  static constexpr std::array kForms{"image",
                                     "image_raw",
                                     "image_mono",
                                     "image_color",
                                     "image_rect",
                                     "image_rect_color",
                                     "compressed",
                                     "raw",
                                     "theora"};
  return std::ranges::find(kForms, part) != kForms.end();
}

std::string LayoutOf(const fs::path& path) {
  if (fs::is_directory(path)) return "ROS 2 bag";
  const std::string extension = path.extension().string();
  return extension == ".bag" ? "ROS 1 bag" : extension == ".db3" ? "ROS 2 bag" : "MCAP";
}

std::string CameraName(const std::string& topic, std::set<std::string>* taken) {
  std::string name = "cam";
  for (const fs::path& part : fs::path(topic)) {
    if (part != "/" && !NamesForm(part.string())) name = part.string();
  }
  const auto make_key = [](std::string text) {
    std::ranges::replace_if(
        text, [](unsigned char c) { return std::isalnum(c) == 0 && c != '_' && c != '-'; }, '_');
    return text;
  };
  name = make_key(name);
  if (taken->contains(name)) name = make_key(topic.substr(topic.find_first_not_of('/')));
  for (int number = 2; !taken->insert(name).second; ++number) name += fmt::format("_{}", number);
  return name;
}

std::optional<BayerOrder> BayerOf(std::string_view encoding) {
  constexpr std::string_view kBegin = "bayer_";
  if (!encoding.starts_with(kBegin)) return std::nullopt;
  std::string order(encoding.substr(kBegin.size(), 4));
  std::ranges::transform(
      order, order.begin(), [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return ParseBayerOrder(order);
}

[[noreturn]] void RefuseTopics(const RecordingFile& file) {
  if (!file.topics.empty()) throw Error(ErrorKind::kInput, file.topics.front().defect);
  std::vector<std::string> names;
  for (const MessageTopic& topic : file.other_topics) {
    names.push_back(fmt::format("{} ({}, {} messages)", topic.name, topic.type, topic.count));
  }
  throw InputError(
      "{}: has no topic with images, which sensor_msgs/Image or "
      "sensor_msgs/CompressedImage of ROS 1 or ROS 2 are; its topics: {}{}",
      file.path.string(),
      names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", ")),
      file.log->DamageText());
}

}  // namespace

RecordingFile FindInMessages(const fs::path& path) {
  RecordingFile file{{.path = path, .layout = LayoutOf(path)}};
  file.log = std::make_shared<const MessageLog>(path);
  file.topics = file.log->ImageTopics();
  file.other_topics = file.log->OtherTopics();
  std::set<std::string> taken;
  for (ImageTopic& topic : file.topics) {
    if (!topic.defect.empty()) continue;
    RecordedFiles camera;
    topic.camera = camera.name = CameraName(topic.name, &taken);
    camera.images = {path.string() + (topic.name.starts_with('/') ? "" : "/") + topic.name};
    camera.where = camera.images[0];
    camera.bayer = BayerOf(topic.encoding);
    file.cameras.push_back(std::move(camera));
  }
  if (file.cameras.empty()) RefuseTopics(file);
  return file;
}

}  // namespace plenocal
