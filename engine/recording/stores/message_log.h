// SPDX-License-Identifier: Apache-2.0
//
// Recordings of messages: one file, or a folder of ROS 2 with several that follow each other.
#pragma once

#include <filesystem>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "calib/files/frame_images.h"
#include "engine/recording/messages/message_file.h"

namespace plenocal {

/// A topic of images and what its first message shows.
struct ImageTopic {
  std::string name;
  std::string type;
  size_t count = 0;
  std::string encoding;     ///< of its pixels; "png", "jpeg" of image files
  ImageSize size{};         ///< {0, 0}: the message cannot be read
  double rate = 0;          ///< images per second by the usual interval; 0: one image
  std::string camera_info;  ///< topic of its intrinsics; empty: none
  std::string camera = {};  ///< of a recording; empty: none
  std::string defect;       ///< why its first image cannot be read; empty: it can
};

class MessageLog : public std::enable_shared_from_this<MessageLog> {
 public:
  /// A file (`IsMessageFileName`), or a folder as `IsMessageFolder` takes it. Throws `Error` of
  /// kind kInput.
  explicit MessageLog(const std::filesystem::path& path);

  [[nodiscard]] const std::filesystem::path& Path() const { return path_; }
  /// Notes on damage in its files, in whole sentences.
  [[nodiscard]] const std::vector<std::string>& Damage() const { return damage_; }
  /// For the end of a message: ". Damage: " and the first; empty where there is none.
  [[nodiscard]] std::string DamageText() const {
    return damage_.empty() ? std::string() : ". Damage: " + damage_[0];
  }
  [[nodiscard]] std::vector<ImageTopic> ImageTopics() const;
  /// Names and types of topics without images.
  [[nodiscard]] std::vector<MessageTopic> OtherTopics() const;

  /// The images of a topic by time, each a frame that is called after its time in nanoseconds;
  /// without a topic those of the only one that has images. `notes` receives what is unusual.
  /// Throws `Error` of kind kInput, which names the topics, where there is no such one.
  [[nodiscard]] std::vector<FrameImage> Images(const std::string& topic,
                                               std::vector<std::string>* notes) const;
  /// The first message of a topic of kind kCameraInfo; nothing when there is none.
  [[nodiscard]] std::optional<CameraInfo> ReadInfo(const std::string& topic) const;

  /// A message of one of the files.
  struct Message {
    size_t file = 0;
    MessageRef ref;
  };
  /// The first `most` bytes, or all of a shorter one.
  [[nodiscard]] SharedBytes Read(const Message& message,
                                 size_t most = std::numeric_limits<size_t>::max()) const;
  [[nodiscard]] const MessageTopic& TopicOf(const Message& message) const;

 private:
  [[nodiscard]] std::vector<Message> MessagesOf(const std::string& topic) const;
  /// Topics of the same name in different files count as one.
  [[nodiscard]] std::vector<MessageTopic> Topics() const;
  [[nodiscard]] std::string ChosenTopic(const std::string& topic) const;
  void Describe(ImageTopic* topic) const;

  std::filesystem::path path_;
  std::vector<std::shared_ptr<const MessageFile>> files_;
  std::vector<std::string> damage_;
};

/// A folder with files of messages, as ROS 2 writes it.
bool IsMessageFolder(const std::filesystem::path& path);

}  // namespace plenocal
