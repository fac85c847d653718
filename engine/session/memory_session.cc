// SPDX-License-Identifier: Apache-2.0
#include "engine/session/memory_session.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <bit>
#include <cstring>
#include <memory>
#include <set>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/quoted_text.h"
#include "calib/files/image_store.h"
#include "calib/io/detection_cache.h"
#include "engine/session/open_session.h"

namespace plenocal {
namespace {

std::size_t RowBytes(const PixelView& view) {
  return static_cast<std::size_t>(view.size[0]) * static_cast<std::size_t>(view.channels) *
         static_cast<std::size_t>(view.bytes_per_value);
}

void CheckPixels(const std::string& where, const PixelView& view) {
  const auto refuse = [&](const std::string& what) { throw InputError("{}: {}", where, what); };
  if (view.data == nullptr) refuse("a view of memory without pixels");
  if (view.size[0] <= 0 || view.size[1] <= 0) {
    refuse(fmt::format("expected a positive size, found {}", fmt::join(view.size, " x ")));
  }
  if (view.channels != 1 && view.channels != 3) {
    refuse(fmt::format("expected 1 or 3 channels, found {}", view.channels));
  }
  if (view.bytes_per_value != 1 && view.bytes_per_value != 2) {
    refuse(fmt::format("expected 1 or 2 bytes per value, found {}", view.bytes_per_value));
  }
  if (view.stride < RowBytes(view)) {
    refuse(fmt::format(
        "the stride of {} bytes is shorter than a row of {}", view.stride, RowBytes(view)));
  }
}

class PixelStore : public ImageStore {
 public:
  explicit PixelStore(std::vector<PixelView> views) : views_(std::move(views)) {}

  [[nodiscard]] StoredImage Read(std::size_t index) const override {
    const PixelView& view = views_[index];
    StoredImage image{.encoding = std::string(view.channels == 1 ? "mono" : "bgr") +
                                  (view.bytes_per_value == 1 ? "8" : "16"),
                      .size = view.size,
                      .step = RowBytes(view),
                      .big_endian = std::endian::native == std::endian::big};
    image.bytes.resize(image.step * static_cast<std::size_t>(view.size[1]));
    for (std::size_t row = 0; row < static_cast<std::size_t>(view.size[1]); ++row) {
      std::memcpy(image.bytes.data() + row * image.step,
                  static_cast<const std::uint8_t*>(view.data) + row * view.stride,
                  image.step);
    }
    return image;
  }
  [[nodiscard]] StoredImage Start(std::size_t index, std::size_t /*most*/) const override {
    return Read(index);
  }
  [[nodiscard]] bool HasFiles() const override { return false; }
  [[nodiscard]] std::string Hash(std::size_t index) const override {
    const StoredImage image = Read(index);
    return HashBytes(image.bytes) + image.encoding + std::to_string(image.step);
  }

 private:
  std::vector<PixelView> views_;
};

}  // namespace

std::vector<FrameImage> ImagesInMemory(const std::string& camera, const MemoryImages& images) {
  std::vector<PixelView> views;
  std::vector<FrameImage> listed;
  std::set<std::string> frames;
  for (const auto& [frame, view] : images) {
    const std::string where = fmt::format("{}: frame {}", camera, frame);
    CheckPixels(where, view);
    if (!frames.insert(frame).second) {
      throw InputError("{} is given twice", where);
    }
    listed.push_back({.frame = frame, .path = where, .index = views.size()});
    views.push_back(view);
  }
  const auto store = std::make_shared<PixelStore>(std::move(views));
  for (FrameImage& image : listed) image.store = store;
  return listed;
}

Session SessionInMemory(const std::string& target, const std::vector<MemoryCamera>& cameras) {
  Session session;
  session.path = "memory";
  session.target.keys = YamlNode::Parse(target, "target");
  std::set<std::string> names;
  for (const MemoryCamera& camera : cameras) {
    if (const auto defect = CameraNameDefect(camera.name)) {
      throw InputError("camera {}: the name {}", camera.name, *defect);
    }
    if (!names.insert(camera.name).second) {
      throw InputError("camera {} is given twice", camera.name);
    }
    if (camera.images.empty() == camera.views.empty()) {
      throw InputError("camera {}: give either images or points", camera.name);
    }
    SessionCamera& own = session.cameras.emplace_back();
    own.name = camera.name;
    own.given_images = ImagesInMemory(camera.name, camera.images);
    own.given_views = camera.views;
    own.image_size = camera.image_size;
    UseModel(camera.model != nullptr ? *camera.model : UsualModel(), &own);
    own.auto_model = camera.model == nullptr;
    session.auto_refine |= own.auto_model;
  }
  if (session.cameras.empty()) throw InputError("no camera is given");
  return session;
}

}  // namespace plenocal
