// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/stores/zip_store.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/io/detection_cache.h"
#include "engine/recording/image_files.h"
#include "engine/recording/zip_archive.h"

namespace plenocal {
namespace {

/// The index of an image is that of its file in the archive.
class ZipStore : public ImageStore {
 public:
  explicit ZipStore(const std::filesystem::path& path) : archive_(path) {}
  [[nodiscard]] const ZipArchive& Archive() const { return archive_; }
  [[nodiscard]] StoredImage Read(size_t index) const override { return {archive_.Read(index)}; }
  [[nodiscard]] StoredImage Start(size_t index, size_t most) const override {
    return {archive_.Read(index, most)};
  }
  [[nodiscard]] std::string Hash(size_t index) const override {
    try {
      return HashBytes(archive_.Read(index));
    } catch (const Error&) {
      return {};
    }
  }

 private:
  ZipArchive archive_;
};

}  // namespace

std::vector<FrameImage> ZipImages(const std::filesystem::path& archive,
                                  const std::string& folder,
                                  const std::string& what) {
  const auto store = std::make_shared<const ZipStore>(archive);
  std::vector<FrameImage> images;
  for (size_t entry = 0; entry < store->Archive().Names().size(); ++entry) {
    const std::filesystem::path name = store->Archive().Names()[entry];
    if (!HasImageName(name)) continue;
    if (!folder.empty() && name.parent_path().generic_string() != folder) continue;
    const std::string frame = name.stem().string();
    if (const auto defect = FrameNameDefect(frame)) {
      throw InputError("{}: {}: the name of its frame, '{}', {}; rename the file",
                       what,
                       store->Archive().Place(entry),
                       frame,
                       *defect);
    }
    images.push_back({.frame = frame,
                      .path = store->Archive().Place(entry),
                      .store = store,
                      .index = entry,
                      .time = {}});
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

}  // namespace plenocal
