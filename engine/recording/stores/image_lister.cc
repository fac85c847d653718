// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/stores/image_lister.h"

#include <algorithm>
#include <iterator>

#include "calib/base/format_error.h"
#include "engine/recording/stores/zip_archive.h"
#include "engine/recording/video/video_store.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

bool IsStore(const fs::path& path) {
  std::error_code error;
  if (IsMessageFolder(path)) return true;
  return IsStoreName(path) && fs::is_regular_file(path, error);
}

void CheckFrames(const std::vector<FrameImage>& images, const std::string& what) {
  std::map<std::string, const FrameImage*> frames;
  for (const FrameImage& image : images) {
    const auto [first, is_new] = frames.emplace(image.frame, &image);
    if (is_new) continue;
    throw InputError(
        "{}: {} and {} both belong to frame '{}'; name one of them, or a "
        "folder of the archive, such as archive.zip/left",
        what,
        first->second->path.string(),
        image.path.string(),
        image.frame);
  }
}

}  // namespace

std::vector<FrameImage> FindImageInputs(const std::vector<std::string>& inputs,
                                        const std::string& what) {
  std::vector<FrameImage> images;
  for (const std::string& input : inputs) {
    if (!std::filesystem::exists(input) && input.find('*') == std::string::npos &&
        SplitStorePattern(input).file.empty()) {
      throw InputError("{}: no such file; check the path", input);
    }
    const std::vector<FrameImage> found = ListImages({input}, what);
    images.insert(images.end(), found.begin(), found.end());
  }
  return images;
}

bool IsStoreName(const fs::path& path) {
  return IsArchiveName(path) || IsVideoName(path) || IsMessageFileName(path);
}

StorePattern SplitStorePattern(const fs::path& pattern) {
  fs::path file;
  for (auto part = pattern.begin(); part != pattern.end(); ++part) {
    file /= *part;
    if (part->empty() || !IsStore(file)) continue;
    // One file of a folder of ROS 2.
    const auto next = std::next(part);
    if (next != pattern.end() && !next->empty() && IsStore(file / *next)) continue;
    std::string rest;
    while (++part != pattern.end()) {
      if (!part->empty()) rest += (rest.empty() ? "" : "/") + part->generic_string();
    }
    return {file, rest};
  }
  return {};
}

void ImageLister::Use(std::shared_ptr<const MessageLog> log) {
  notes_.insert(notes_.end(), log->Damage().begin(), log->Damage().end());
  const std::filesystem::path path = log->Path();
  logs_[path] = std::move(log);
}

std::vector<FrameImage> ImageLister::InRecording(const fs::path& path, const std::string& topic) {
  std::shared_ptr<const MessageLog>& log = logs_[path];
  if (!log) Use(std::make_shared<const MessageLog>(path));
  return log->Images(topic, &notes_);
}

std::vector<FrameImage> ImageLister::List(const std::vector<std::string>& patterns,
                                          const std::string& what) {
  std::vector<FrameImage> images;
  bool has_store = false;
  std::vector<std::string> on_disk;
  for (const std::string& pattern : patterns) {
    const StorePattern store = SplitStorePattern(pattern);
    if (store.file.empty()) {
      on_disk.push_back(pattern);
      continue;
    }
    has_store = true;
    std::vector<FrameImage> found;
    if (IsArchiveName(store.file)) {
      found = ZipImages(store.file, store.part, what);
    } else if (IsVideoName(store.file)) {
      if (!store.part.empty()) {
        throw InputError("{}: {}: a video has no parts; give the video alone", what, pattern);
      }
      found = VideoImages(store.file, &notes_);
    } else {
      found = InRecording(store.file, store.part);
    }
    std::ranges::move(found, std::back_inserter(images));
  }
  std::vector<FrameImage> files = ExpandImages(on_disk, what);
  std::ranges::move(files, std::back_inserter(images));
  if (has_store) CheckFrames(images, what);
  return images;
}

std::vector<FrameImage> ListImages(const std::vector<std::string>& patterns,
                                   const std::string& what) {
  return ImageLister().List(patterns, what);
}

}  // namespace plenocal
