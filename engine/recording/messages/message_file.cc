// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/message_file.h"

#include <algorithm>

#include "calib/base/names.h"

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
  const std::string extension = LowerCase(path.extension().string());
  return extension == ".mcap" || extension == ".bag" || extension == ".db3";
}

}  // namespace plenocal
