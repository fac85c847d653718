// SPDX-License-Identifier: Apache-2.0
#include "apps/recording/image_files.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <set>
#include <utility>

#include "calib/base/error.h"
#include "calib/base/input_file.h"
#include "calib/base/quoted_text.h"
#include "calib/files/frame_images.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;

class FileSource : public ImageSource {
 public:
  explicit FileSource(std::vector<ImageFile> files) : files_(std::move(files)) {}

  std::vector<unsigned char> Bytes(size_t index) const override {
    const ImageFile& file = files_[index];
    if (file.archive) return file.archive->Read(file.entry);
    const std::string content = ReadInput(file.path, InputLimit::kTable);
    return {content.begin(), content.end()};
  }
  std::vector<unsigned char> Start(size_t index, size_t most) const override {
    const ImageFile& file = files_[index];
    if (file.archive) return file.archive->Read(file.entry, most);
    const std::string content = ReadInputStart(file.path, most);
    return {content.begin(), content.end()};
  }
  std::string Place(size_t index) const override { return files_[index].path.string(); }

 private:
  std::vector<ImageFile> files_;
};

/// An archive, and the folder in it that is meant; empty: all of it.
struct ArchivePart {
  fs::path archive;
  std::string folder;
};

/// Nothing for a pattern that leads into no archive.
std::optional<ArchivePart> ArchivePartOf(const fs::path& pattern) {
  fs::path archive;
  for (auto part = pattern.begin(); part != pattern.end(); ++part) {
    archive /= *part;
    std::error_code error;
    if (!IsArchiveName(archive) || !fs::is_regular_file(archive, error)) continue;
    fs::path folder;
    while (++part != pattern.end()) folder /= *part;
    std::string name = folder.generic_string();
    while (name.ends_with('/')) name.pop_back();
    return ArchivePart{archive, name};
  }
  return std::nullopt;
}

void AddFilesOf(const ArchivePart& part, const std::string& what, std::vector<ImageFile>* files) {
  const auto archive = std::make_shared<const ZipArchive>(part.archive);
  const size_t before = files->size();
  for (size_t entry = 0; entry < archive->Names().size(); ++entry) {
    const fs::path name = archive->Names()[entry];
    if (!HasImageName(name)) continue;
    if (!part.folder.empty() && name.parent_path().generic_string() != part.folder) continue;
    files->push_back({.name = name.stem().string(),
                      .path = archive->Place(entry),
                      .archive = archive,
                      .entry = entry});
  }
  if (files->size() > before) return;
  throw Error(ErrorKind::kInput,
              fmt::format("{}: no image (png, tiff, jpeg, bmp, pgm) in {}{}",
                          what,
                          part.folder.empty() ? "" : fmt::format("the folder {} of ", part.folder),
                          part.archive.string()));
}

void CheckNames(const std::vector<ImageFile>& files, const std::string& what) {
  for (const ImageFile& file : files) {
    if (const auto defect = FrameNameDefect(file.name)) {
      throw Error(ErrorKind::kInput,
                  fmt::format("{}: {}: the name of its frame, '{}', {}; rename the file",
                              what,
                              file.path.string(),
                              file.name,
                              *defect));
    }
  }
  const auto twin = std::ranges::adjacent_find(files, std::ranges::equal_to{}, &ImageFile::name);
  if (twin == files.end()) return;
  throw Error(
      ErrorKind::kInput,
      fmt::format("{}: {} and {} both belong to frame '{}'; name one folder of the archive, "
                  "such as archive.zip/left, or use a pattern that tells them apart",
                  what,
                  twin->path.string(),
                  std::next(twin)->path.string(),
                  twin->name));
}

/// Of a name that is a number the number without leading zeros.
std::string NumberKey(const std::string& name) {
  const bool number = !name.empty() && std::ranges::all_of(name, [](unsigned char c) {
    return std::isdigit(c) != 0;
  });
  return number ? name.substr(std::min(name.find_first_not_of('0'), name.size() - 1)) : name;
}

}  // namespace

ImageIndex::ImageIndex(const std::vector<std::string>& names, const std::vector<fs::path>& files) {
  for (size_t i = 0; i < names.size(); ++i) index_of_.emplace(names[i], i);
  for (size_t i = 0; i < files.size(); ++i) index_of_.emplace(files[i].stem().string(), i);
  for (size_t i = 0; i < names.size(); ++i) {
    index_of_.emplace(NumberKey(names[i]), i);
    index_of_.emplace(NumberKey(files[i].stem().string()), i);
  }
}

std::optional<size_t> ImageIndex::Find(const std::string& text) const {
  const std::string stem =
      HasImageName(text) ? fs::path(text).stem().string() : fs::path(text).filename().string();
  for (const std::string& key : {text, stem, NumberKey(stem)}) {
    if (const auto found = index_of_.find(key); found != index_of_.end()) return found->second;
  }
  return std::nullopt;
}

std::vector<ImageFile> FindImageFiles(const std::vector<std::string>& patterns,
                                      const std::string& what) {
  std::vector<ImageFile> files;
  std::vector<std::string> on_disk;
  for (const std::string& pattern : patterns) {
    if (const auto part = ArchivePartOf(pattern)) {
      AddFilesOf(*part, what, &files);
    } else {
      on_disk.push_back(pattern);
    }
  }
  for (FrameImage& image : ExpandImages(on_disk, what)) {
    files.push_back({.name = std::move(image.frame), .path = std::move(image.path)});
  }
  std::ranges::stable_sort(files, NaturalLess, &ImageFile::name);
  CheckNames(files, what);
  return files;
}

std::shared_ptr<const ImageSource> MakeImageSource(std::vector<ImageFile> files) {
  return std::make_shared<const FileSource>(std::move(files));
}

std::vector<std::string> ImageFoldersIn(const ZipArchive& archive) {
  std::set<std::string> folders;
  for (const fs::path name : archive.Names()) {
    if (HasImageName(name)) folders.insert(name.parent_path().generic_string());
  }
  return {folders.begin(), folders.end()};
}

bool IsArchiveName(const fs::path& path) {
  return path.extension() == ".zip" || path.extension() == ".ZIP";
}

bool NaturalLess(std::string_view a, std::string_view b) {
  const auto digits = [](std::string_view text) {
    const auto end = std::ranges::find_if(text, [](unsigned char c) { return !std::isdigit(c); });
    return text.substr(0, static_cast<size_t>(end - text.begin()));
  };
  const std::string_view whole_a = a, whole_b = b;
  while (!a.empty() && !b.empty()) {
    std::string_view x = digits(a), y = digits(b);
    if (x.empty() || y.empty()) {
      if (a.front() != b.front()) return a.front() < b.front();
      a.remove_prefix(1);
      b.remove_prefix(1);
      continue;
    }
    a.remove_prefix(x.size());
    b.remove_prefix(y.size());
    x.remove_prefix(std::min(x.find_first_not_of('0'), x.size()));
    y.remove_prefix(std::min(y.find_first_not_of('0'), y.size()));
    if (x.size() != y.size()) return x.size() < y.size();
    if (x != y) return x < y;
  }
  if (a.empty() != b.empty()) return a.empty();
  return whole_a < whole_b;  // "1" and "01"
}

}  // namespace plenocal
