// SPDX-License-Identifier: Apache-2.0
#include "calib/io/detection_cache.h"

#define XXH_INLINE_ALL
#include <fmt/format.h>
#include <unistd.h>
#include <xxhash.h>

#include <atomic>
#include <fstream>
#include <system_error>
#include <utility>

#include "calib/base/error.h"
#include "calib/io/input_file.h"

namespace plenocal {
namespace {

std::string Hash(std::string_view bytes) {
  const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
  return fmt::format("{:016x}{:016x}", hash.high64, hash.low64);
}

// An entry is the hash of its key and content, then the content.
std::string Seal(const std::string& key, const std::string& content) { return Hash(key + content); }

// True for "<key>" and for "<key>.<process>.<count>", the temporary file of an entry.
bool IsNameOfEntry(std::string_view name) {
  constexpr size_t kKey = 2 * sizeof(XXH128_hash_t);
  const std::string_view key = name.substr(0, kKey), rest = name.substr(key.size());
  return key.size() == kKey &&
         key.find_first_not_of("0123456789abcdef") == std::string_view::npos &&
         (rest.empty() || rest[0] == '.') &&
         rest.find_first_not_of(".0123456789") == std::string_view::npos;
}

// The content of an entry; empty when there is none.
std::string ReadEntry(const std::filesystem::path& path) {
  try {
    return ReadEarlierResult(path);
  } catch (const Error&) {
    return {};
  }
}

}  // namespace

std::string HashBytes(std::span<const std::uint8_t> bytes) {
  return Hash({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

std::string HashFile(const std::filesystem::path& path) {
  try {
    return Hash(ReadInput(path, InputLimit::kTable));
  } catch (const Error&) {
    return {};
  }
}

DetectionCache::DetectionCache(std::filesystem::path folder, std::string program, bool fresh)
    : folder_(std::move(folder)), program_(std::move(program)), fresh_(fresh) {}

std::string DetectionCache::Key(std::initializer_list<std::string_view> parts) const {
  // Lengths, so that parts cannot run into each other.
  std::string all = program_;
  for (const std::string_view part : parts) {
    if (part.empty()) return {};
    all += fmt::format("\n{} ", part.size());
    all += part;
  }
  return Hash(all);
}

std::optional<std::string> DetectionCache::Load(const std::string& key) {
  if (key.empty() || folder_.empty()) return std::nullopt;
  {
    const std::lock_guard lock(mutex_);
    if (fresh_ && !used_.contains(key)) return std::nullopt;
  }
  std::string content = ReadEntry(folder_ / key);
  const size_t seal = 2 * sizeof(XXH128_hash_t);
  if (content.size() < seal) return std::nullopt;
  const std::string found = content.substr(0, seal);
  content.erase(0, seal);
  if (found != Seal(key, content)) return std::nullopt;
  const std::lock_guard lock(mutex_);
  used_.insert(key);
  return content;
}

void DetectionCache::Save(const std::string& key, const std::string& content) {
  if (key.empty() || folder_.empty()) return;
  static std::atomic<int> count{0};  // of the process: two caches may have one folder
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  const std::filesystem::path partial =
      folder_ / fmt::format("{}.{}.{}", key, getpid(), count.fetch_add(1));
  {
    std::ofstream file(partial, std::ios::binary | std::ios::trunc);
    file << Seal(key, content) << content;
    file.close();
    if (!file) {
      std::filesystem::remove(partial, error);
      return;
    }
  }
  std::filesystem::rename(partial, folder_ / key, error);
  if (error) std::filesystem::remove(partial, error);
  const std::lock_guard lock(mutex_);
  used_.insert(key);
}

void DetectionCache::RemoveUnused() {
  std::error_code error;
  const std::lock_guard lock(mutex_);
  if (std::filesystem::is_symlink(folder_, error)) return;
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    if (IsNameOfEntry(name) && !used_.contains(name)) {
      std::filesystem::remove(entry.path(), error);
    }
  }
  std::filesystem::remove(folder_, error);  // when it is empty
}

}  // namespace plenocal
