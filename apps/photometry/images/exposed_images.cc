// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/images/exposed_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>

#include "calib/base/format_error.h"
#include "calib/base/names.h"
#include "calib/base/quoted_text.h"

namespace plenocal {

const RecordedCamera& ChooseRecordedCamera(const Recording& recording, const std::string& name) {
  const std::vector<std::string_view> names = NamesOf(recording.cameras);
  if (name.empty()) {
    if (recording.cameras.size() == 1) return recording.cameras[0];
    throw InputError("{}: has {} cameras ({}); choose one with --camera",
                     recording.path.string(),
                     names.size(),
                     fmt::join(names, ", "));
  }
  if (const RecordedCamera* camera = recording.FindCamera(name)) return *camera;
  throw InputError(
      "{}: has no camera '{}'{}", recording.path.string(), name, SuggestName(name, names));
}

cv::Mat ReadExposed(const RecordedCamera& camera, std::size_t index) {
  cv::Mat image = camera.Read(index);
  if (image.depth() == CV_8U) return image;
  throw InputError("{}: has 16 bits; a response holds 256 values: record with 8 bits a pixel",
                   camera.images[index].path.string());
}

std::vector<double> ExposuresOf(const Recording& recording,
                                const RecordedCamera& camera,
                                const std::string& purpose) {
  std::vector<double> exposures;
  for (const RecordedImage& image : camera.images) {
    if (image.exposure) exposures.push_back(*image.exposure);
  }
  if (exposures.size() == camera.images.size()) return exposures;
  throw InputError(
      "{}: camera {}: {} of {} images have no exposure time; write lines 'name "
      "time exposure' into the file that 'times' names, {}",
      recording.path.string(),
      camera.name,
      camera.images.size() - exposures.size(),
      camera.images.size(),
      purpose);
}

std::string ExposureRow(const std::string& frame,
                        const std::string& camera,
                        double exposure,
                        double relative,
                        double sigma) {
  const std::string known = std::isnan(exposure) ? "" : fmt::format("{:.7g}", exposure);
  return fmt::format(
      "{},{},{},{:.5g},{:.4g}\n", CsvCell(frame), CsvCell(camera), known, relative, sigma);
}

std::vector<LeftOut> LeftOutOf(const Recording& recording, const RecordedCamera& camera) {
  std::vector<LeftOut> items;
  std::ranges::copy_if(recording.left_out, std::back_inserter(items), [&](const LeftOut& item) {
    return item.camera == camera.name;
  });
  return items;
}

}  // namespace plenocal
