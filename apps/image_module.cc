// SPDX-License-Identifier: Apache-2.0
#include "apps/image_module.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <filesystem>

#include "calib/error.h"

namespace plenocal {
namespace {

void* LoadModule() {
  const std::filesystem::path program =
      std::filesystem::read_symlink("/proc/self/exe").parent_path();
  // Beside the program in a build tree, in the library folder once installed.
  std::string reason;
  for (const auto& folder : {program, program / PLENOCAL_MODULE_FOLDER}) {
    const std::filesystem::path path = folder / PLENOCAL_IMAGE_MODULE;
    if (!std::filesystem::exists(path)) continue;
    if (void* module = dlopen(path.c_str(), RTLD_NOW | RTLD_LOCAL)) return module;
    reason = dlerror();
  }
  throw Error(
      ErrorKind::kJob,
      fmt::format("cannot load {}, the part of plenocal that reads images ({}); install plenocal "
                  "again",
                  PLENOCAL_IMAGE_MODULE,
                  reason.empty() ? "no such file" : reason));
}

}  // namespace

ImageDetections DetectImagesByModule(const std::vector<FrameImage>& images,
                                     const Target& target,
                                     const DetectOptions& options) {
  static void* const kModule = LoadModule();
  const auto detect =
      reinterpret_cast<decltype(&plenocal_detect_images)>(dlsym(kModule, "plenocal_detect_images"));
  if (detect == nullptr) {
    throw Error(ErrorKind::kJob,
                fmt::format("{} is of another version of plenocal", PLENOCAL_IMAGE_MODULE));
  }
  ImageDetections detections;
  detect(images, target, options, &detections);
  return detections;
}

}  // namespace plenocal
