// SPDX-License-Identifier: Apache-2.0
//
// Files of messages: MCAP, bags of ROS 1, databases of ROS 2.
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "engine/recording/messages/byte_range.h"
#include "engine/recording/messages/ros_messages.h"

namespace plenocal {

struct MessageTopic {
  std::string name;  ///< as the file has it, "/left/image_raw"
  std::string type;
  MessageKind kind = MessageKind::kOther;
  MessageCoding coding = MessageCoding::kOther;
  size_t count = 0;  ///< messages
};

/// The place of a message of a topic about images.
struct MessageRef {
  std::uint32_t topic = 0;
  std::int64_t logged = 0;  ///< ns, when it was written
  std::int64_t stamp = 0;   ///< ns, of its header; 0: it has none
  std::uint64_t block = 0;  ///< chunk or row; of the file's format
  std::uint64_t offset = 0, size = 0;
};

/// A file with all its topics, and the messages of those about images in its order. `Read` may be
/// called from several threads.
class MessageFile {
 public:
  MessageFile() = default;
  virtual ~MessageFile() = default;
  MessageFile(const MessageFile&) = delete;
  MessageFile& operator=(const MessageFile&) = delete;

  [[nodiscard]] const std::vector<MessageTopic>& Topics() const { return topics_; }
  [[nodiscard]] const std::vector<MessageRef>& Messages() const { return messages_; }
  /// Notes on damage and on what it costs; most files have none.
  [[nodiscard]] const std::vector<std::string>& Damage() const { return damage_; }
  /// The first `most` bytes of a message, or all of a shorter one. Throws `Error` of kind kInput.
  [[nodiscard]] virtual SharedBytes Read(const MessageRef& message, size_t most) const = 0;

 protected:
  /// The index of a topic, which is added where it is new.
  std::uint32_t TopicIndex(const std::string& name, const std::string& type, MessageCoding coding);
  /// Counts a message whose first bytes are `start`, and keeps where it is.
  void AddMessage(MessageRef message, ByteSpan start);
  [[nodiscard]] bool IsWanted(std::uint32_t topic) const;
  void AddDamage(std::string damage) { damage_.push_back(std::move(damage)); }

 private:
  std::vector<MessageTopic> topics_;
  std::vector<MessageRef> messages_;
  std::vector<std::string> damage_;
};

/// Names that end in .mcap, .bag or .db3.
bool IsMessageFileName(const std::filesystem::path& path);

/// Opens a file by its first bytes and reads where its messages are. Throws `Error` of kind kInput
/// for one that is none of the formats, or has no message before its damage.
std::shared_ptr<const MessageFile> OpenMessageFile(const std::filesystem::path& path);

}  // namespace plenocal
