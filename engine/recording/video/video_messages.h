// SPDX-License-Identifier: Apache-2.0
//
// Messages between `VideoDecoder` and the program that decodes a video. Both are of one build, so
// that a message is sent as it lies in memory.
#pragma once

#include <sys/socket.h>

#include <cerrno>
#include <cstddef>

namespace plenocal {

enum class VideoRequest : int {
  kGrab,      ///< decode the next frame
  kRetrieve,  ///< send its pixels after the answer: BGR, rows without gaps
  kSeek,      ///< make frame number `index` the next one
};

struct VideoQuestion {
  VideoRequest request = VideoRequest::kGrab;
  int index = 0;
};

/// The first answer, before any question, reports the opening of the file.
struct VideoAnswer {
  bool good = false;
  int width = 0, height = 0;  ///< of opening and of kRetrieve
  double frames = 0;          ///< of opening: their number as the container states it
  double time = 0;            ///< of kGrab: s since the beginning
};

/// Sends all bytes; false when the other side has ended.
inline bool SendAll(int socket, const void* data, std::size_t size) {
  for (const auto* at = static_cast<const char*>(data); size > 0;) {
    const ssize_t count = send(socket, at, size, MSG_NOSIGNAL);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    at += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

/// Receives all bytes; false when the other side has ended.
inline bool ReceiveAll(int socket, void* data, std::size_t size) {
  for (auto* at = static_cast<char*>(data); size > 0;) {
    const ssize_t count = recv(socket, at, size, 0);
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) return false;
    at += count;
    size -= static_cast<std::size_t>(count);
  }
  return true;
}

}  // namespace plenocal
