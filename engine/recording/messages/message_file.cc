// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/message_file.h"

#include <algorithm>
#include <cctype>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"
#include "engine/recording/messages/bag_file.h"
#include "engine/recording/messages/db3_file.h"
#include "engine/recording/messages/mcap_file.h"

namespace plenocal {

std::uint32_t MessageFile::TopicIndex(const std::string& name,
                                      const std::string& type,
                                      MessageCoding coding) {
  const auto found = std::ranges::find_if(topics_, [&](const MessageTopic& topic) {
    return topic.name == name && topic.type == type && topic.coding == coding;
  });
  if (found != topics_.end()) return static_cast<std::uint32_t>(found - topics_.begin());
  topics_.push_back({.name = name, .type = type, .kind = KindOfType(type), .coding = coding});
  return static_cast<std::uint32_t>(topics_.size() - 1);
}

bool MessageFile::IsWanted(std::uint32_t topic) const {
  return topics_[topic].kind != MessageKind::kOther;
}

void MessageFile::AddMessage(MessageRef message, ByteSpan start) {
  MessageTopic& topic = topics_[message.topic];
  ++topic.count;
  // Packed chunks hold any number of empty ones; a day has 8.6 million at 100 Hz.
  constexpr size_t kMost = 10'000'000;
  if (topic.kind == MessageKind::kOther || messages_.size() == kMost) return;
  message.stamp = StampOf(topic.coding, start).value_or(0);
  messages_.push_back(message);
  if (messages_.size() == kMost) {
    AddDamage("has 10 million messages about images; no more are read");
  }
}

bool IsMessageFileName(const std::filesystem::path& path) {
  std::string extension = path.extension().string();
  std::ranges::transform(extension, extension.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return extension == ".mcap" || extension == ".bag" || extension == ".db3";
}

std::shared_ptr<const MessageFile> OpenMessageFile(const std::filesystem::path& path) {
  constexpr std::size_t kStart = 16;
  const std::string start = ReadInputStart(path, kStart);
  std::shared_ptr<const MessageFile> file;
  if (start.starts_with(kMcapMagic)) {
    file = std::make_shared<const McapFile>(path);
  } else if (start.starts_with(kBagMagic)) {
    file = std::make_shared<const BagFile>(path);
  } else if (start.starts_with(kDb3Magic)) {
    file = std::make_shared<const Db3File>(path);
  } else if (start.starts_with("#ROSBAG")) {
    throw InputError("{}: is a bag of an old version, '{}'; convert it by 'rosbag migrate'",
                     path.string(),
                     start.substr(0, start.find('\n')));
  } else {
    throw InputError("{}: {}; copy it again",
                     path.string(),
                     start.empty() ? "is empty (0 bytes)"
                                   : "is no MCAP file, bag of ROS 1 or database of ROS 2, "
                                     "or damaged at its beginning");
  }
  if (file->Topics().empty() && !file->Damage().empty()) {
    throw InputError(
        "{}: {}, and holds no message before; copy it again", path.string(), file->Damage()[0]);
  }
  return file;
}

}  // namespace plenocal
