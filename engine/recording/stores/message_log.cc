// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/stores/message_log.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <map>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/io/detection_cache.h"
#include "detectors/images/image_header.h"
#include "engine/recording/stores/image_index.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

constexpr double kNanosecond = 1e-9;

bool HasImages(const MessageTopic& topic) {
  return topic.coding != MessageCoding::kOther &&
         (topic.kind == MessageKind::kImage || topic.kind == MessageKind::kCompressedImage);
}

/// Paths in patterns have no leading slash of their own.
std::string_view WithoutSlash(std::string_view topic) {
  return topic.starts_with('/') ? topic.substr(1) : topic;
}

std::vector<fs::path> MessageFilesIn(const fs::path& folder) {
  std::vector<fs::path> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (IsMessageFileName(entry.path())) files.push_back(entry.path());
  }
  std::ranges::sort(files, NaturalLess, [](const fs::path& file) { return file.string(); });
  return files;
}

/// Half-written files of ROS 2 that have been packed as a whole.
bool HasPackedFiles(const fs::path& folder) {
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    if (entry.path().extension() == ".zstd") return true;
  }
  return false;
}

class TopicStore : public ImageStore {
 public:
  TopicStore(std::shared_ptr<const MessageLog> log,
             std::vector<MessageLog::Message> messages,
             std::string place)
      : log_(std::move(log)), messages_(std::move(messages)), place_(std::move(place)) {}

  [[nodiscard]] StoredImage Read(size_t index) const override {
    const MessageLog::Message& message = messages_[index];
    const MessageTopic& topic = log_->TopicOf(message);
    return ReadImageMessage(topic.kind, topic.coding, log_->Read(message).bytes, place_);
  }
  [[nodiscard]] StoredImage Start(size_t index, size_t most) const override {
    const MessageLog::Message& message = messages_[index];
    const MessageTopic& topic = log_->TopicOf(message);
    return ReadImageMessage(
        topic.kind, topic.coding, log_->Read(message, most).bytes, place_, MessagePart::kStart);
  }
  [[nodiscard]] std::string Hash(size_t index) const override {
    try {
      return HashBytes(log_->Read(messages_[index]).bytes);
    } catch (const Error&) {
      return {};
    }
  }

 private:
  std::shared_ptr<const MessageLog> log_;
  std::vector<MessageLog::Message> messages_;
  std::string place_;
};

/// The time by which an image is known: that of its header, or of the log where the driver sets
/// none.
enum class Clock { kHeader, kLog };

std::int64_t TimeOf(const MessageRef& ref, Clock clock) {
  return clock == Clock::kHeader ? ref.stamp : ref.logged;
}

/// Sorts messages by time; notes where they were not.
void SortByTime(Clock clock,
                const std::string& place,
                std::vector<MessageLog::Message>* messages,
                std::vector<std::string>* notes) {
  const auto time = [&](const MessageLog::Message& message) { return TimeOf(message.ref, clock); };
  size_t jumps = 0;
  for (size_t i = 1; i < messages->size(); ++i) {
    jumps += time((*messages)[i]) < time((*messages)[i - 1]) ? 1 : 0;
  }
  if (jumps > 0) {
    notes->push_back(
        fmt::format("{}: its times jump backwards {} times; images are taken in the "
                    "order of their times. Was the clock set while recording?",
                    place,
                    jumps));
  }
  std::ranges::stable_sort(*messages, {}, time);
  // Not std::ranges::unique: Clang 14, which the fuzzer needs, has none with GCC's library.
  const auto kept = std::unique(messages->begin(),
                                messages->end(),
                                [&](const auto& a, const auto& b) { return time(a) == time(b); });
  if (kept != messages->end()) {
    notes->push_back(fmt::format("{}: {} images have the time of another one and are left out",
                                 place,
                                 messages->end() - kept));
  }
  messages->erase(kept, messages->end());
}

}  // namespace

bool IsMessageFolder(const fs::path& path) {
  std::error_code error;
  return fs::is_directory(path, error) && fs::exists(path / "metadata.yaml", error) &&
         (!MessageFilesIn(path).empty() || HasPackedFiles(path));
}

MessageLog::MessageLog(const fs::path& path) : path_(path) {
  std::vector<fs::path> files{path};
  if (fs::is_directory(path)) files = MessageFilesIn(path);
  if (files.empty()) {
    throw InputError("{}: its files are packed as a whole; unpack them by 'zstd -d {}'",
                     path.string(),
                     (path / "*.zstd").string());
  }
  for (const fs::path& file : files) {
    try {
      files_.push_back(OpenMessageFile(file));
    } catch (const Error& error) {
      if (files.size() == 1) throw;
      damage_.emplace_back(error.what());
      continue;
    }
    // The first of many damages shows what to do.
    const std::vector<std::string>& found = files_.back()->Damage();
    if (found.empty()) continue;
    damage_.push_back(fmt::format(
        "{}: {}{}",
        file.string(),
        found[0],
        found.size() > 1 ? fmt::format(" (and {} more)", found.size() - 1) : std::string()));
  }
  if (files_.empty()) throw Error(ErrorKind::kInput, damage_[0]);
}

SharedBytes MessageLog::Read(const Message& message, size_t most) const {
  return files_[message.file]->Read(message.ref, most);
}

const MessageTopic& MessageLog::TopicOf(const Message& message) const {
  return files_[message.file]->Topics()[message.ref.topic];
}

std::vector<MessageTopic> MessageLog::Topics() const {
  // A damaged file may give one name to images and to other messages.
  std::map<std::pair<std::string, MessageKind>, MessageTopic> by_name;
  for (const auto& file : files_) {
    for (const MessageTopic& topic : file->Topics()) {
      const auto [place, is_new] = by_name.emplace(std::pair(topic.name, topic.kind), topic);
      if (!is_new) place->second.count += topic.count;
    }
  }
  std::vector<MessageTopic> topics;
  for (auto& [name, topic] : by_name) topics.push_back(std::move(topic));
  return topics;
}

std::vector<MessageTopic> MessageLog::OtherTopics() const {
  std::vector<MessageTopic> topics = Topics();
  std::erase_if(topics, [](const MessageTopic& topic) {
    return (HasImages(topic) && topic.count > 0) || topic.kind == MessageKind::kCameraInfo;
  });
  return topics;
}

std::vector<MessageLog::Message> MessageLog::MessagesOf(const std::string& topic) const {
  std::vector<Message> messages;
  for (size_t f = 0; f < files_.size(); ++f) {
    const std::vector<MessageTopic>& topics = files_[f]->Topics();
    for (const MessageRef& ref : files_[f]->Messages()) {
      if (topics[ref.topic].name == topic) messages.push_back({f, ref});
    }
  }
  return messages;
}

std::vector<ImageTopic> MessageLog::ImageTopics() const {
  const std::vector<MessageTopic> all = Topics();
  std::vector<ImageTopic> topics;
  for (const MessageTopic& topic : all) {
    if (!HasImages(topic) || topic.count == 0) continue;
    ImageTopic& found = topics.emplace_back();
    found.name = topic.name;
    found.type = topic.type;
    found.count = topic.count;
    // ROS puts it beside the images of a camera, whatever transports they have.
    for (fs::path folder = fs::path(topic.name).parent_path(); found.camera_info.empty();
         folder = folder.parent_path()) {
      const std::string name = (folder / "camera_info").string();
      const bool is_there = std::ranges::any_of(all, [&](const MessageTopic& other) {
        return other.name == name && other.kind == MessageKind::kCameraInfo && other.count > 0;
      });
      if (is_there) found.camera_info = name;
      if (folder == folder.parent_path()) break;
    }
    Describe(&found);
  }
  return topics;
}

void MessageLog::Describe(ImageTopic* topic) const {
  const std::vector<Message> messages = MessagesOf(topic->name);
  std::vector<double> intervals;
  for (size_t i = 1; i < messages.size(); ++i) {
    // Times of a damaged file may lie farther apart than their type holds.
    intervals.push_back(static_cast<double>(messages[i].ref.logged) -
                        static_cast<double>(messages[i - 1].ref.logged));
  }
  const double interval = Median(intervals) * kNanosecond;
  topic->rate = interval > 0 ? 1 / interval : 0;
  try {
    const MessageTopic& of = TopicOf(messages[0]);
    const StoredImage image = ReadImageMessage(
        of.kind, of.coding, Read(messages[0]).bytes, (path_ / WithoutSlash(topic->name)).string());
    topic->encoding = image.encoding;
    topic->size = image.size;
    if (!image.encoding.empty()) return;
    const std::string start(
        image.bytes.begin(),
        image.bytes.begin() + std::min<std::ptrdiff_t>(4, image.bytes.end() - image.bytes.begin()));
    topic->encoding = start.starts_with("\x89PNG")    ? "png"
                      : start.starts_with("\xff\xd8") ? "jpeg"
                                                      : "image file";
    topic->size = SizeInHeader(image.bytes).value_or(ImageSize{});
  } catch (const Error& error) {
    topic->defect = error.what();
  }
}

std::string MessageLog::ChosenTopic(const std::string& topic) const {
  std::vector<std::string> with_images;
  std::optional<MessageTopic> other;
  for (const MessageTopic& each : Topics()) {
    const bool is_it = WithoutSlash(each.name) == WithoutSlash(topic);
    if (HasImages(each) && each.count > 0) {
      if (is_it) return each.name;
      with_images.push_back(each.name);
    } else if (is_it) {
      other = each;
    }
  }
  if (with_images.empty()) {
    throw InputError(
        "{}: has no topic with images (sensor_msgs/Image or CompressedImage of "
        "ROS 1 or ROS 2); 'plenocal recording {}' lists its topics{}",
        path_.string(),
        path_.string(),
        DamageText());
  }
  if (topic.empty() && with_images.size() == 1) return with_images[0];
  std::string what = "has several topics with images";
  if (other) {
    what = fmt::format(
        "topic '{}' has {}",
        other->name,
        other->count == 0 ? "no message" : fmt::format("no images but {}", other->type));
  } else if (!topic.empty()) {
    what = fmt::format("has no topic '{}'", topic);
  }
  throw InputError("{}: {}; name one of them, such as '{}': {}",
                   path_.string(),
                   what,
                   (path_ / WithoutSlash(with_images[0])).string(),
                   fmt::join(with_images, ", "));
}

std::vector<FrameImage> MessageLog::Images(const std::string& topic,
                                           std::vector<std::string>* notes) const {
  const std::string name = ChosenTopic(topic);
  const fs::path place = path_ / WithoutSlash(name);
  std::vector<Message> messages = MessagesOf(name);
  const bool stamped =
      std::ranges::any_of(messages, [](const Message& message) { return message.ref.stamp != 0; });
  if (!stamped) {
    notes->push_back(
        fmt::format("{}: the headers have no times; those of the log are taken, which "
                    "are later by the transport of the images",
                    place.string()));
  }
  const Clock clock = stamped ? Clock::kHeader : Clock::kLog;
  SortByTime(clock, place.string(), &messages, notes);
  std::vector<FrameImage> images;
  for (const Message& message : messages) {
    const std::int64_t time = TimeOf(message.ref, clock);
    const std::string frame = fmt::format("{:019}", time);
    images.push_back({.frame = frame,
                      .path = place / frame,
                      .store = {},
                      .index = images.size(),
                      .time = static_cast<double>(time) * kNanosecond});
  }
  const auto store =
      std::make_shared<const TopicStore>(shared_from_this(), std::move(messages), place.string());
  for (FrameImage& image : images) image.store = store;
  return images;
}

std::optional<CameraInfo> MessageLog::ReadInfo(const std::string& topic) const {
  const std::vector<Message> messages = MessagesOf(topic);
  if (messages.empty()) return std::nullopt;
  return ReadCameraInfo(
      TopicOf(messages[0]).coding, Read(messages[0]).bytes, (path_ / WithoutSlash(topic)).string());
}

}  // namespace plenocal
