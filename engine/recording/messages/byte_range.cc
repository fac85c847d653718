// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/messages/byte_range.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "calib/base/format_error.h"
#include "calib/io/input_file.h"

namespace plenocal {

InputBytes::InputBytes(const std::filesystem::path& path)
    : path_(path), descriptor_(OpenInput(path)) {
  struct stat status {};
  if (fstat(descriptor_, &status) == 0) size_ = static_cast<std::uint64_t>(status.st_size);
}

InputBytes::~InputBytes() { close(descriptor_); }

void InputBytes::Read(std::uint64_t offset, std::span<std::uint8_t> out) const {
  while (!out.empty()) {
    const ssize_t count = pread(descriptor_, out.data(), out.size(), static_cast<off_t>(offset));
    if (count < 0 && errno == EINTR) continue;
    if (count <= 0) {
      throw InputError("{}: cannot be read at byte {} ({}); copy it again",
                       path_.string(),
                       offset,
                       count == 0 ? "it ends there" : std::strerror(errno));
    }
    out = out.subspan(static_cast<std::size_t>(count));
    offset += static_cast<std::uint64_t>(count);
  }
}

ByteSpan ByteRange::Get(std::uint64_t at, std::size_t size) {
  if (file_ == nullptr) return memory_.subspan(at, size);
  if (at < buffer_at_ || at + size > buffer_at_ + buffer_.size()) {
    // Headers of several small messages at once; of images no more than their headers.
    constexpr std::size_t kAhead = 4096;
    buffer_.resize(std::min<std::uint64_t>(std::max(size, kAhead), size_ - at));
    buffer_at_ = at;
    file_->Read(offset_ + at, buffer_);
  }
  return ByteSpan(buffer_).subspan(at - buffer_at_, size);
}

}  // namespace plenocal
