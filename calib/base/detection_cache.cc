// SPDX-License-Identifier: Apache-2.0
#include "calib/base/detection_cache.h"

#define XXH_INLINE_ALL
#include <fmt/format.h>
#include <unistd.h>
#include <xxhash.h>

#include <atomic>
#include <fstream>
#include <sstream>
#include <system_error>
#include <utility>

namespace plenocal {
namespace {

std::string Hash(std::string_view bytes) {
  const XXH128_hash_t hash = XXH3_128bits(bytes.data(), bytes.size());
  return fmt::format("{:016x}{:016x}", hash.high64, hash.low64);
}

std::optional<std::string> ReadAll(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::ostringstream text;
  text << file.rdbuf();
  if (file.bad()) return std::nullopt;
  return std::move(text).str();
}

// An entry is the hash of its key and content, then the content.
std::string Seal(const std::string& key, const std::string& content) { return Hash(key + content); }

}  // namespace

std::string HashFile(const std::filesystem::path& path) {
  const std::optional<std::string> content = ReadAll(path);
  return content ? Hash(*content) : std::string();
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
  std::optional<std::string> entry = ReadAll(folder_ / key);
  const size_t seal = 2 * sizeof(XXH128_hash_t);
  if (!entry || entry->size() < seal) return std::nullopt;
  std::string content = entry->substr(seal);
  if (entry->compare(0, seal, Seal(key, content)) != 0) return std::nullopt;
  const std::lock_guard lock(mutex_);
  used_.insert(key);
  return content;
}

void DetectionCache::Save(const std::string& key, const std::string& content) {
  if (key.empty() || folder_.empty()) return;
  static std::atomic<int> count{0};
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
  for (const auto& entry : std::filesystem::directory_iterator(folder_, error)) {
    if (!used_.contains(entry.path().filename().string())) {
      std::filesystem::remove(entry.path(), error);
    }
  }
  std::filesystem::remove(folder_, error);  // when it is empty
}

}  // namespace plenocal
