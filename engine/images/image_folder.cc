// SPDX-License-Identifier: Apache-2.0
#include "engine/images/image_folder.h"

#include <filesystem>
#include <mutex>

#include "calib/base/format_error.h"
#include "engine/resample/resample_images.h"

namespace plenocal {
namespace {

std::optional<ResponseCurve> ResponseOf(const ResampleSettings& settings,
                                        const std::string& camera) {
  for (const std::string& given : settings.photometric) {
    const size_t equals = given.find('=');
    if (equals == std::string::npos) return ReadResponse(given);
    if (given.substr(0, equals) == camera) return ReadResponse(given.substr(equals + 1));
  }
  if (settings.photometric.empty()) return std::nullopt;
  throw InputError("--photometric: names no response of camera '{0}'; add {0}=pcalib.txt", camera);
}

}  // namespace

void CheckImageNames(const std::vector<FrameImage>& images, const std::string& suffix) {
  std::map<std::string, std::filesystem::path> seen;
  for (const FrameImage& image : images) {
    const auto [first, is_new] = seen.emplace(image.frame, image.path);
    if (!is_new) {
      throw InputError(
          "{} and {}: both results would be named '{}{}'; run them with "
          "different -o",
          first->second.string(),
          image.path.string(),
          image.frame,
          suffix);
    }
  }
}

size_t ResampleToFolder(const std::vector<FrameImage>& images,
                        const FolderResampling& resampling,
                        const Run& run,
                        OutputFolder* out) {
  const CalibratedCamera& camera = resampling.camera;
  const ResampleSettings& settings = resampling.settings;
  ResampleRequest request;
  request.images = images;
  request.map = &resampling.map;
  if (!settings.keep_vignetting && !camera.vignetting.empty()) {
    request.vignetting = resampling.calibration.path.parent_path() / camera.vignetting;
  }
  request.response = ResponseOf(settings, camera.name);
  request.bayer = settings.bayer;
  request.interpolation = settings.interpolation;
  request.threads = run.threads;
  request.message = [&](const std::string& line) { run.Message(line); };
  request.progress = [&](size_t done) {
    return run.Progress(camera.name + ": images", done, images.size());
  };
  std::mutex keeping;
  request.result = [&](const std::string& frame, const std::string& png) {
    out->Write(resampling.prefix + frame + ".png", png);
    if (resampling.keep == nullptr) return;
    const std::lock_guard lock(keeping);
    (*resampling.keep)[frame] = png;
  };
  return ResampleImages(request);
}

}  // namespace plenocal
