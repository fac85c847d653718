// SPDX-License-Identifier: Apache-2.0
#include "apps/image_module.h"

#include <dlfcn.h>
#include <fmt/format.h>

#include <array>
#include <filesystem>

#include "calib/error.h"
#include "calib/stage_store.h"

namespace plenocal {
namespace {

/// Beside the program in a build tree, in the library folder once installed.
std::array<std::filesystem::path, 2> ModulePaths() {
  const std::filesystem::path program =
      std::filesystem::read_symlink("/proc/self/exe").parent_path();
  return {program / PLENOCAL_IMAGE_MODULE,
          program / PLENOCAL_MODULE_FOLDER / PLENOCAL_IMAGE_MODULE};
}

void* LoadModule() {
  std::string reason;
  for (const auto& path : ModulePaths()) {
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

void* Module() {
  static void* const kModule = LoadModule();
  return kModule;
}

/// The function `name` of the module, of the type of its declaration.
template <typename Function>
Function* FromModule(const char* name) {
  void* const module = Module();
  void* const found = dlsym(module, name);
  if (found == nullptr) {
    throw Error(ErrorKind::kJob,
                fmt::format("{} is of another version of plenocal", PLENOCAL_IMAGE_MODULE));
  }
  return reinterpret_cast<Function*>(found);
}

}  // namespace

std::string ImageModuleHash() {
  for (const auto& path : ModulePaths()) {
    if (std::string hash = HashFile(path); !hash.empty()) return hash;
  }
  return {};
}

ImageDetections DetectImagesByModule(const std::vector<FrameImage>& images,
                                     const Target& target,
                                     const DetectOptions& options) {
  using Detect = decltype(plenocal_detect_images);
  ImageDetections detections;
  FromModule<Detect>("plenocal_detect_images")(images, target, options, &detections);
  return detections;
}

WhiteCamera MeasureWhiteImagesByModule(const std::vector<FrameImage>& images,
                                       const WhiteOptions& options) {
  using Measure = decltype(plenocal_measure_white_images);
  WhiteCamera camera;
  FromModule<Measure>("plenocal_measure_white_images")(images, options, &camera);
  return camera;
}

void FocusImagesByModule(const FocusRequest& request) {
  FromModule<decltype(plenocal_focus_images)>("plenocal_focus_images")(request);
}

std::vector<std::filesystem::path> PrintTargetByModule(const PrintCommand& command) {
  std::vector<std::filesystem::path> written;
  FromModule<decltype(plenocal_print_target)>("plenocal_print_target")(command, &written);
  return written;
}

std::string SimulateByModule(const SimulateCommand& command, const SimulateOptions& options) {
  std::string summary;
  FromModule<decltype(plenocal_simulate)>("plenocal_simulate")(command, options, &summary);
  return summary;
}

std::string DrawBarChartByModule(const BarChart& chart, PictureFormat format) {
  std::string content;
  FromModule<decltype(plenocal_draw_bar_chart)>("plenocal_draw_bar_chart")(chart, format, &content);
  return content;
}

std::string DrawFieldMapsByModule(const std::vector<FieldMap>& maps, double largest) {
  std::string content;
  FromModule<decltype(plenocal_draw_field_maps)>("plenocal_draw_field_maps")(
      maps, largest, &content);
  return content;
}

AttenuationMap ReadAttenuationMapByModule(const std::string& tiff,
                                          const std::string& name,
                                          int longer) {
  AttenuationMap map;
  FromModule<decltype(plenocal_read_attenuation_map)>("plenocal_read_attenuation_map")(
      tiff, name, longer, &map);
  return map;
}

size_t ResampleImagesByModule(const ResampleRequest& request) {
  size_t count = 0;
  FromModule<decltype(plenocal_resample_images)>("plenocal_resample_images")(request, &count);
  return count;
}

size_t MakeVirtualViewsByModule(const VirtualViewRequest& request) {
  size_t count = 0;
  FromModule<decltype(plenocal_make_virtual_views)>("plenocal_make_virtual_views")(request, &count);
  return count;
}

std::string VignettePngByModule(const std::filesystem::path& attenuation) {
  std::string png;
  FromModule<decltype(plenocal_vignette_png)>("plenocal_vignette_png")(attenuation, &png);
  return png;
}

std::map<std::string, std::string> MapFilesByModule(const PixelMap& map,
                                                    const std::vector<double>& pinhole,
                                                    const std::string& format) {
  std::map<std::string, std::string> files;
  FromModule<decltype(plenocal_map_files)>("plenocal_map_files")(map, pinhole, format, &files);
  return files;
}

}  // namespace plenocal
