// SPDX-License-Identifier: Apache-2.0
#include "detectors/plenoptic/views/view_images.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/number_text.h"
#include "detectors/images/image.h"
#include "detectors/plenoptic/depth/reconstruction.h"
#include "detectors/plenoptic/views/sub_aperture.h"
#include "detectors/plenoptic/white/grid_mismatch.h"

namespace plenocal {
namespace {

namespace fs = std::filesystem;
using internal::LensPatches;
using internal::ViewGrid;

cv::Mat ReadRaw(const fs::path& path, const PlenopticCamera& camera) {
  cv::Mat raw = ReadImage(path);
  const ImageSize size = camera.array.image_size;
  if (raw.cols != size[0] || raw.rows != size[1]) {
    throw InputError("{}: is {} x {} pixels, but the micro lenses are those of {} x {}",
                     path.string(),
                     raw.cols,
                     raw.rows,
                     size[0],
                     size[1]);
  }
  cv::Mat grey;
  ToGray(raw).convertTo(grey, CV_32F);
  const std::string mismatch = internal::GridMismatch(grey, camera.attenuation, camera.array);
  if (!mismatch.empty()) throw JobError("{}: {}", path.string(), mismatch);
  return raw;
}

/// The smallest, the middle and the largest virtual depth of the image, without its outermost
/// tenths; of an image without depths those around the micro lenses.
std::vector<RefocusPlane> ChoosePlanes(const ViewsRequest& request,
                                       const cv::Mat& raw,
                                       const PlenopticCamera& camera) {
  std::vector<RefocusPlane> planes;
  try {
    ReconstructionOptions options;
    options.threads = request.threads;
    const Reconstruction view = Reconstruct(raw.clone(), camera, options);
    if (const auto shift = SignificantShift(std::span(&view.lattice, 1))) {
      request.message(fmt::format("  {}: {}", request.raw_image.string(), ShiftText(*shift)));
    }
    std::vector<float> inverse = internal::KnownInverse(view.depth);
    std::ranges::sort(inverse);
    for (const size_t tenth : {9, 5, 1}) {
      planes.push_back({1 / inverse.at(tenth * (inverse.size() - 1) / 10)});
    }
  } catch (const Error& error) {
    if (error.kind() == ErrorKind::kInput) throw;
    request.message(fmt::format(
        "  no virtual depth ({}); refocused around the micro lenses as for an unfocused camera",
        error.what()));
    for (const double v : {-0.8, -0.4, 0.0, 0.4, 0.8}) planes.push_back({v});
  }
  return planes;
}

/// Grey values in 8 bits, all images alike; black where nothing is known.
class Brightness {
 public:
  explicit Brightness(const LensPatches& patches) {
    std::vector<float> known;
    for (const float value : patches.value) {
      if (!std::isnan(value)) known.push_back(value);
    }
    // Of a picture with some bright spots the rest remains visible.
    constexpr double kBelow = 0.999;
    const auto place = static_cast<std::ptrdiff_t>(kBelow * static_cast<double>(known.size()));
    std::nth_element(known.begin(), known.begin() + place, known.end());
    scale_ = 255 / std::max(1e-6, static_cast<double>(known[static_cast<size_t>(place)]));
  }
  [[nodiscard]] cv::Mat Grey(const cv::Mat& image) const {
    cv::Mat grey = image.clone();
    cv::patchNaNs(grey, 0);
    grey.convertTo(grey, CV_8U, scale_);
    return grey;
  }

 private:
  double scale_ = 1;
};

std::string ViewsYaml(const ViewsRequest& request,
                      const std::vector<std::pair<std::string, Eigen::Vector2d>>& views,
                      const std::vector<std::pair<std::string, RefocusPlane>>& refocused) {
  std::string text = fmt::format(
      "plenocal: 1\n"
      "# pixel (x, y) of every image lies at raw pixel offset + scale * (x, y)\n"
      "offset: [0, 0]\nscale: {}\n"
      "# places in the micro images, px from their centres\n"
      "views:\n",
      YamlNumber(request.step));
  for (const auto& [name, offset] : views) {
    text += fmt::format("  - {{file: {}, offset: [{}, {}]}}\n",
                        name,
                        YamlNumber(offset.x()),
                        YamlNumber(offset.y()));
  }
  text += "refocused:\n";
  for (const auto& [name, plane] : refocused) {
    text += fmt::format("  - {{file: {}, virtual_depth: {}", name, YamlNumber(plane.virtual_depth));
    if (plane.distance) text += fmt::format(", distance: {}", YamlNumber(*plane.distance));
    text += "}\n";
  }
  return text;
}

}  // namespace

ViewsResult MakeViews(const ViewsRequest& request) {
  const PlenopticCamera camera = LoadPlenopticCamera(
      request.camera, {.frame = {}, .path = request.raw_image}, request.threads, request.message);
  const cv::Mat raw = ReadRaw(request.raw_image, camera);
  const std::vector<RefocusPlane> planes =
      request.planes.empty() ? ChoosePlanes(request, raw, camera) : request.planes;
  const LensPatches patches = GreyPatches(raw, camera, request.threads);
  const internal::MicroLensIndex index(camera.array);
  const ViewGrid grid = internal::MakeViewGrid(camera.array.image_size, request.step);
  const Brightness brightness(patches);
  const double pitch = std::min(camera.array.e_column.norm(), camera.array.e_row.norm());

  ViewsResult result;
  std::vector<std::pair<std::string, Eigen::Vector2d>> views;
  cv::Mat sheet(grid.size * request.views, CV_8U);
  for (int row = 0; row < request.views; ++row) {
    for (int column = 0; column < request.views; ++column) {
      const double middle = (request.views - 1) / 2.0;
      const Eigen::Vector2d offset = request.radius * pitch / std::max(1.0, middle) *
                                     Eigen::Vector2d(column - middle, row - middle);
      // The corners of the square would lie outside of the round micro images.
      const double length = offset.cwiseAbs().maxCoeff();
      const Eigen::Vector2d inside =
          offset.norm() > 0 ? Eigen::Vector2d(offset * (length / offset.norm())) : offset;
      const cv::Mat grey =
          brightness.Grey(internal::SubApertureImage(patches, index, inside, grid));
      const std::string name = fmt::format("view_{}_{}.png", row, column);
      result.files[name] = EncodeImage(".png", grey);
      views.emplace_back(name, inside);
      grey.copyTo(sheet(cv::Rect({column * grid.size.width, row * grid.size.height}, grid.size)));
    }
  }
  result.files["views.png"] = EncodeImage(".png", sheet);
  std::vector<std::pair<std::string, RefocusPlane>> refocused;
  for (size_t k = 0; k < planes.size(); ++k) {
    const std::string name = fmt::format("refocused_{}.png", k);
    const cv::Mat image =
        internal::RefocusedImage(patches, camera.array, planes[k].virtual_depth, grid);
    result.files[name] = EncodeImage(".png", brightness.Grey(image));
    refocused.emplace_back(name, planes[k]);
  }
  result.files["views.yaml"] = ViewsYaml(request, views, refocused);
  result.summary = fmt::format("{} views, {} refocused images of {} x {} pixels",
                               views.size(),
                               refocused.size(),
                               grid.size.width,
                               grid.size.height);
  return result;
}

}  // namespace plenocal
