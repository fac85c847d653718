// SPDX-License-Identifier: Apache-2.0
#include "apps/workbench/live_look.h"

#include <charconv>
#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string_view>
#include <vector>

#include "apps/suggest/suggestions_json.h"
#include "assess/pose_spread.h"
#include "calib/base/error.h"
#include "calib/files/image_store.h"

namespace plenocal::workbench {
namespace {

// One image file in memory.
class OnePicture : public ImageStore {
 public:
  explicit OnePicture(std::string_view content) : bytes_(content.begin(), content.end()) {}

  [[nodiscard]] StoredImage Read(std::size_t) const override { return {.bytes = bytes_}; }
  [[nodiscard]] StoredImage Start(std::size_t, std::size_t) const override {
    return {.bytes = bytes_};
  }
  [[nodiscard]] std::string Hash(std::size_t) const override { return {}; }

 private:
  std::vector<std::uint8_t> bytes_;
};

std::map<std::string, FrameImage> PicturesOf(std::string_view sizes, std::string_view content) {
  const auto wrong = [] {
    return Error(ErrorKind::kInput, "pictures: expected CAMERA:BYTES,... as long as the body");
  };
  std::map<std::string, FrameImage> pictures;
  while (!sizes.empty()) {
    const std::string_view one = sizes.substr(0, sizes.find(','));
    sizes.remove_prefix(std::min(sizes.size(), one.size() + 1));
    const size_t colon = one.rfind(':');
    size_t bytes = 0;
    if (colon == std::string_view::npos ||
        std::from_chars(one.data() + colon + 1, one.data() + one.size(), bytes).ptr !=
            one.data() + one.size() ||
        bytes == 0 || bytes > content.size()) {
      throw wrong();
    }
    const std::string camera(one.substr(0, colon));
    pictures[camera] = {.frame = "live",
                        .path = "live picture",
                        .store = std::make_shared<OnePicture>(content.substr(0, bytes))};
    content.remove_prefix(bytes);
  }
  if (pictures.empty() || !content.empty()) throw wrong();
  return pictures;
}

double SecondsSince(std::chrono::steady_clock::time_point start) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

void LiveLook::Open(const std::filesystem::path& run_folder) {
  std::error_code error;
  const auto time = std::filesystem::last_write_time(run_folder / "calibration.yaml", error);
  if (scale_ && folder_ == run_folder && time_ == time) return;
  scale_.reset();
  scale_.emplace(run_folder, 0);
  folder_ = run_folder;
  time_ = time;
}

PictureGain LiveLook::Evaluate(const std::map<std::string, FrameImage>& images) {
  const auto start = std::chrono::steady_clock::now();
  PictureGain gain = scale_->Evaluate(images);
  detection_seconds_ = SecondsSince(start);
  return gain;
}

nlohmann::json LiveLook::Weigh(const std::filesystem::path& run_folder,
                               const std::string& sizes,
                               const std::string& pictures) {
  const std::map<std::string, FrameImage> images = PicturesOf(sizes, pictures);
  const std::lock_guard lock(mutex_);
  Open(run_folder);
  return PictureGainJson(Evaluate(images));
}

nlohmann::json LiveLook::Keep(const std::string& frame) {
  const std::lock_guard lock(mutex_);
  return scale_ ? Add(frame) : nlohmann::json(nullptr);
}

nlohmann::json LiveLook::Renew(const std::filesystem::path& run_folder,
                               const std::map<std::string, FrameImage>& images) {
  const std::lock_guard lock(mutex_);
  Open(run_folder);
  return Evaluate(images).gain ? Add(images.begin()->second.frame) : nlohmann::json(nullptr);
}

void LiveLook::Prepare(const std::filesystem::path& run_folder) {
  const std::lock_guard lock(mutex_);
  Open(run_folder);
}

nlohmann::json LiveLook::Add(const std::string& frame) {
  const auto start = std::chrono::steady_clock::now();
  scale_->Keep(frame);
  const double seconds = SecondsSince(start);
  const LiveCalibration& live = scale_->Live();
  nlohmann::json json = SuggestionsJson(live.Suggested());
  json["seconds"] = seconds;
  json["detection_seconds"] = detection_seconds_;
  for (size_t c = 0; c < live.Record().cameras.size(); ++c) {
    const CalibratedCamera& camera = live.Record().cameras[c];
    nlohmann::json parameters = nlohmann::json::array();
    for (size_t k = 0; k < camera.params.size(); ++k) {
      parameters.push_back({camera.model->params[k].name, camera.params[k], camera.Sigma(k)});
    }
    json["calibration"][camera.name] = {{"coverage", MeasurePoseSpread(live.Record(), c).coverage},
                                        {"parameters", parameters}};
  }
  return json;
}

}  // namespace plenocal::workbench
