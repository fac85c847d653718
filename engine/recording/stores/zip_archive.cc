// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/stores/zip_archive.h"

#include <fmt/format.h>
#include <unistd.h>
#include <zip.h>

#include <algorithm>
#include <limits>
#include <new>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/detection_cache.h"
#include "calib/io/input_file.h"
#include "engine/recording/stores/image_index.h"

namespace plenocal {
namespace {

struct CloseZipFile {
  void operator()(zip_file_t* file) const { zip_fclose(file); }
};

}  // namespace

void ZipArchive::Close::operator()(zip* archive) const { zip_discard(archive); }

ZipArchive::ZipArchive(const std::filesystem::path& path) : path_(path) {
  const int descriptor = OpenInput(path);
  int code = 0;
  archive_.reset(zip_fdopen(descriptor, ZIP_RDONLY, &code));
  if (!archive_) {
    close(descriptor);
    zip_error_t error;
    zip_error_init_with_code(&error, code);
    const std::string reason = zip_error_strerror(&error);
    zip_error_fini(&error);
    throw InputError(
        "{}: is no zip archive that can be read ({}); copy it again", path.string(), reason);
  }
  const zip_int64_t count = zip_get_num_entries(archive_.get(), 0);
  for (zip_int64_t i = 0; i < count; ++i) {
    const char* const name = zip_get_name(archive_.get(), static_cast<zip_uint64_t>(i), 0);
    if (name == nullptr || std::string_view(name).ends_with('/')) continue;
    // A name that begins with a slash would be a file elsewhere.
    const std::string_view relative = name;
    names_.emplace_back(
        relative.substr(std::min(relative.find_first_not_of('/'), relative.size())));
    indices_.push_back(static_cast<size_t>(i));
  }
}

std::string ZipArchive::Place(size_t file) const { return (path_ / names_[file]).string(); }

StoredImage ZipArchive::Read(size_t file) const {
  return Start(file, std::numeric_limits<size_t>::max());
}

std::string ZipArchive::Hash(size_t file) const {
  try {
    return HashBytes(Read(file).bytes);
  } catch (const Error&) {
    return {};
  }
}

StoredImage ZipArchive::Start(size_t file, size_t most) const {
  const std::lock_guard lock(mutex_);
  const std::unique_ptr<zip_file_t, CloseZipFile> opened(
      zip_fopen_index(archive_.get(), indices_[file], 0));
  if (!opened) {
    throw InputError("{}: cannot be read ({}); pack the archive again",
                     Place(file),
                     zip_error_strerror(zip_get_error(archive_.get())));
  }
  constexpr size_t kStep = 1 << 16;
  constexpr auto kLimit = static_cast<size_t>(InputLimit::kImage);
  const auto check = [&](zip_uint64_t size) {
    if (size <= kLimit) return;
    throw InputError("{}: larger than {} MB; is it an image?", Place(file), kLimit >> 20);
  };
  // The size in the archive's directory may be wrong: the memory grows with what is really there.
  zip_stat_t stated{};
  const bool is_stated = zip_stat_index(archive_.get(), indices_[file], 0, &stated) == 0;
  if (is_stated && (stated.valid & ZIP_STAT_SIZE) != 0) check(stated.size);
  std::vector<unsigned char> content;
  while (content.size() < most) {
    const size_t length = content.size();
    content.resize(length + std::min(most - length, std::max(length, kStep)));
    const zip_int64_t count =
        zip_fread(opened.get(), content.data() + length, content.size() - length);
    if (count < 0) {
      throw InputError("{}: is damaged ({}); pack the archive again",
                       Place(file),
                       zip_error_strerror(zip_file_get_error(opened.get())));
    }
    content.resize(length + static_cast<size_t>(count));
    if (count == 0) break;
    check(content.size());
  }
  return {.bytes = std::move(content)};
}

bool IsArchiveName(const std::filesystem::path& path) {
  return path.extension() == ".zip" || path.extension() == ".ZIP";
}

std::vector<std::string> ImageFoldersIn(const ZipArchive& archive) {
  std::set<std::string> folders;
  for (const std::filesystem::path name : archive.Names()) {
    if (HasImageName(name)) folders.insert(name.parent_path().generic_string());
  }
  return {folders.begin(), folders.end()};
}

std::vector<FrameImage> ZipImages(const std::filesystem::path& archive,
                                  const std::string& folder,
                                  const std::string& what) {
  const auto store = std::make_shared<const ZipArchive>(archive);
  std::vector<FrameImage> images;
  for (size_t entry = 0; entry < store->Names().size(); ++entry) {
    const std::filesystem::path name = store->Names()[entry];
    if (!HasImageName(name)) continue;
    if (!folder.empty() && name.parent_path().generic_string() != folder) continue;
    const std::string frame = name.stem().string(), place = store->Place(entry);
    if (const auto defect = FrameNameDefect(frame)) {
      throw InputError(
          "{}: {}: the name of its frame, '{}', {}; rename the file", what, place, frame, *defect);
    }
    images.push_back({.frame = frame, .path = place, .store = store, .index = entry, .time = {}});
  }
  if (images.empty()) {
    throw InputError("{}: no image (png, tiff, jpeg, bmp, pgm) in {}{}",
                     what,
                     folder.empty() ? "" : fmt::format("the folder {} of ", folder),
                     archive.string());
  }
  std::ranges::stable_sort(images, NaturalLess, &FrameImage::frame);
  return images;
}

std::string ZipBytes(const OutputContents& files) {
  zip_error_t error;
  zip_error_init(&error);
  zip_source_t* const bytes = zip_source_buffer_create(nullptr, 0, 0, &error);
  zip_t* const archive =
      bytes == nullptr ? nullptr : zip_open_from_source(bytes, ZIP_TRUNCATE, &error);
  if (archive == nullptr) throw std::bad_alloc();
  zip_source_keep(bytes);  // beyond the archive's end
  const std::unique_ptr<zip_source_t, void (*)(zip_source_t*)> kept(bytes, zip_source_free);
  bool done = true;
  for (const auto& [name, content] : files) {
    zip_source_t* const file = zip_source_buffer(archive, content.data(), content.size(), 0);
    const zip_int64_t index = zip_file_add(archive, name.c_str(), file, ZIP_FL_ENC_UTF_8);
    constexpr zip_uint16_t kMidnight = 0, kFirstDay = (1 << 5) + 1;  // 1 January 1980
    done = done && index >= 0 &&
           zip_file_set_dostime(
               archive, static_cast<zip_uint64_t>(index), kMidnight, kFirstDay, 0) == 0;
  }
  if (!done || zip_close(archive) != 0) {
    const std::string reason = zip_strerror(archive);
    zip_discard(archive);
    throw JobError("cannot make a zip archive: {}", reason);
  }
  zip_stat_t size;
  zip_stat_init(&size);
  if (zip_source_stat(bytes, &size) != 0 || zip_source_open(bytes) != 0) throw std::bad_alloc();
  std::string packed(size.size, '\0');
  const zip_int64_t count = zip_source_read(bytes, packed.data(), packed.size());
  zip_source_close(bytes);
  if (count != std::ssize(packed)) throw std::bad_alloc();
  return packed;
}

}  // namespace plenocal
