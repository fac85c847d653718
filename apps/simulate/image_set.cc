// SPDX-License-Identifier: Apache-2.0
#include "apps/simulate/image_set.h"

#include <set>

#include "apps/simulate/random.h"
#include "apps/simulate/sensor.h"
#include "calib/base/format_error.h"
#include "calib/base/parallel.h"
#include "detectors/images/image.h"

namespace plenocal::simulate {

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

void WriteImages(const std::vector<ImageTask>& tasks,
                 int threads,
                 const std::function<void(std::size_t done, std::size_t total)>& progress,
                 OutputFolder* out) {
  std::mutex mutex;
  size_t done = 0;
  ParallelFor(tasks.size(), threads, [&](size_t i) {
    const std::string file = EncodeImage(".png", tasks[i].make());
    const std::lock_guard lock(mutex);
    out->Write(tasks[i].name, file);
    progress(++done, tasks.size());
  });
}

cv::Mat TakeWhite(const Renderer& renderer,
                  const CameraSpec& camera,
                  int seed,
                  std::size_t camera_index,
                  std::size_t index) {
  Random random(seed, "white", {camera_index, index});
  constexpr double kFlicker = 0.01;  // of the lamp
  return Expose(renderer.White() * (1 + random.Gaussian(kFlicker)), camera.sensor, &random);
}

}  // namespace plenocal::simulate
