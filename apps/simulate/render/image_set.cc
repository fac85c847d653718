// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/render/image_set.h"

#include <fmt/format.h>

#include <algorithm>
#include <mutex>
#include <set>

#include "apps/simulate/render/sensor.h"
#include "apps/simulate/spec/random.h"
#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "detectors/images/image.h"

namespace plenocal::simulate {
namespace {

void RefuseOtherImages(const std::vector<ImageTask>& tasks, const std::filesystem::path& out) {
  std::set<std::filesystem::path> expected, folders;
  for (const ImageTask& task : tasks) {
    expected.insert(out / task.name);
    folders.insert((out / task.name).parent_path());
  }
  for (const std::filesystem::path& folder : folders) {
    std::error_code error;
    for (const auto& entry : std::filesystem::directory_iterator(folder, error)) {
      if (entry.path().extension() != ".png" || expected.contains(entry.path())) continue;
      throw InputError(
          "{}: is no image of this session but would be taken for one; remove "
          "it or give another folder with -o",
          entry.path().string());
    }
  }
}

}  // namespace

Renderers MakeRenderers(const SimulationSpec& spec, const Observer& observer, int threads) {
  Renderers renderers;
  for (size_t c = 0; c < spec.cameras.size(); ++c) {
    const CameraSpec& camera = spec.cameras[c];
    const MicroLensOptics* optics = observer.Optics(c);
    renderers.push_back(optics == nullptr
                            ? MakeOrdinaryRenderer(camera)
                            : MakePlenopticRenderer(camera, *optics, spec.seed, threads));
  }
  return renderers;
}

std::uint64_t SamplingSeed(const SimulationSpec& spec, size_t camera, size_t frame) {
  return static_cast<std::uint64_t>(spec.seed) * 1000003 + camera * 65537 + frame;
}

std::vector<ImageTask> ListCameraImages(const SimulationSpec& spec,
                                        size_t camera,
                                        const Renderer& renderer,
                                        const std::vector<std::string>& frames,
                                        const std::function<cv::Mat(size_t frame)>& light,
                                        int white_images) {
  const CameraSpec& taken_by = spec.cameras[camera];
  std::vector<ImageTask> tasks;
  for (size_t f = 0; f < frames.size(); ++f) {
    tasks.push_back({fmt::format("{}/{}.png", taken_by.name, frames[f]),
                     taken_by.IsPlenoptic(),
                     [&spec, &taken_by, light, camera, f] {
                       Random random(spec.seed, "image", {camera, f});
                       return Expose(light(f), taken_by.sensor, &random);
                     }});
  }
  for (size_t i = 0; i < static_cast<size_t>(white_images); ++i) {
    tasks.push_back({fmt::format("{}_white/white_{:02}.png", taken_by.name, i),
                     false,
                     [&spec, &taken_by, &renderer, camera, i] {
                       constexpr double kFlicker = 0.01;  // of the lamp
                       Random random(spec.seed, "white", {camera, i});
                       const double lamp = 1 + random.Gaussian(kFlicker);
                       return Expose(renderer.White() * lamp, taken_by.sensor, &random);
                     }});
  }
  return tasks;
}

void WriteImages(std::vector<ImageTask> tasks,
                 const std::filesystem::path& folder,
                 int threads,
                 const Progress& progress,
                 OutputFolder* out) {
  RefuseOtherImages(tasks, folder);
  std::stable_partition(
      tasks.begin(), tasks.end(), [](const ImageTask& task) { return task.slow; });
  std::mutex mutex;
  size_t done = 0;
  ParallelFor(tasks.size(), threads, [&](size_t i) {
    const std::string file = EncodeImage(".png", tasks[i].make());
    const std::lock_guard lock(mutex);
    out->Write(tasks[i].name, file);
    progress("images", ++done, tasks.size());
  });
}

}  // namespace plenocal::simulate
