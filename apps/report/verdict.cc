// SPDX-License-Identifier: Apache-2.0
#include "apps/report/verdict.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "calib/noise/weak_directions.h"

namespace plenocal {
namespace {

constexpr double kDegrees = 180 / std::numbers::pi;

// Of a whole image an even spread of poses fills nearly all; a fisheye lens leaves its corners dark
// (1 - pi / 4).
constexpr double kCoverageWeak = 0.7, kCoverageBad = 0.3;
// Perspective of a plane turned by a few degrees drowns in its distance: d(1/z) ~ tilt.
constexpr double kTiltWeak = 30, kTiltBad = 12;
// Farthest over nearest image.
constexpr double kDepthWeak = 1.5, kDepthOne = 1.15;
// Each view of a plane gives two equations on the intrinsics; the rest is redundancy.
constexpr int kViewsWeak = 10, kViewsBad = 4;
// Errors of model or target are as large as the noise.
constexpr double kNoiseWeak = 2, kPatternWeak = 0.3;
constexpr double kRejectedWeak = 0.05;

double Quantile(std::vector<double> values, double part) {
  const auto at = values.begin() + std::lround(part * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

std::string Length(double metres) {
  return metres < 1 ? fmt::format("{:.3g} mm", 1e3 * metres) : fmt::format("{:.3g} m", metres);
}

/// Where the used points are.
class PoseSpread {
 public:
  PoseSpread(const CalibrationRecord& calibration, size_t c) {
    const CalibratedCamera& camera = calibration.cameras[c];
    std::vector<double> x, y;
    std::map<int, std::vector<double>> distances, depths;
    std::map<int, RigidTransform> poses;
    ImageGrid grid(camera.image_size, kCells);
    std::vector<bool> seen(grid.Cells(), false);
    for (const ResidualRow& row : camera.residuals) {
      if (!row.used) continue;
      x.push_back((row.values[0] + 0.5) / camera.image_size[0]);
      y.push_back((row.values[1] + 0.5) / camera.image_size[1]);
      seen[grid.Cell(row.values[0], row.values[1])] = true;
      auto pose = poses.find(row.frame);
      if (pose == poses.end()) {
        pose = poses.emplace(row.frame, calibration.CameraFromTarget(c, row.frame)).first;
      }
      const Eigen::Vector3d place = pose->second * calibration.markers.at(row.marker).position;
      distances[row.frame].push_back(place.norm());
      depths[row.frame].push_back(place.z());
    }
    if (x.empty()) return;
    any = true;
    coverage = static_cast<double>(std::count(seen.begin(), seen.end(), true)) /
               static_cast<double>(grid.Cells());
    // Without the few farthest out, which may be mistakes.
    constexpr double kTail = 0.01;
    left = Quantile(x, kTail);
    right = Quantile(x, 1 - kTail);
    top = Quantile(y, kTail);
    bottom = Quantile(y, 1 - kTail);

    // One depth all over the image is one distance too: a parallel target shows nothing else.
    const auto [near, far] = RangeOfMedians(distances);
    const auto [near_depth, far_depth] = RangeOfMedians(depths);
    const bool by_depth = near_depth > 0 && far_depth / near_depth < far / near;
    nearest = by_depth ? near_depth : near;
    farthest = by_depth ? far_depth : far;
    MeasureTilt(calibration, poses);
    FindEmptyParts(grid, seen);
  }

  bool any = false;
  double coverage = 0;                              // part of the image's cells with points
  double left = 0, right = 0, top = 0, bottom = 0;  // parts of width and height
  double nearest = 0, farthest = 0;                 // of the images' median distances or depths, m
  bool is_plane = false;                            // the target
  // Largest angle between the plane's normals in two images, of a target in space between the
  // directions from which they look at it, degrees.
  double tilt = 0;
  double lean = 0;                 // angle of their mean with the optical axis, degrees
  std::vector<std::string> empty;  // ninths of the image without any point

  /// "upper left corner"; empty when the points are on both sides of the middle each way.
  [[nodiscard]] std::string Region() const {
    constexpr double kMiddle = 0.55;
    const char* across = right < kMiddle ? "left" : left > 1 - kMiddle ? "right" : "";
    const char* along = bottom < kMiddle ? "upper" : top > 1 - kMiddle ? "lower" : "";
    if (*across != 0 && *along != 0) return fmt::format("the {} {} corner", along, across);
    if (*across != 0) return fmt::format("the {} half", across);
    if (*along != 0) return fmt::format("the {} half", along);
    constexpr double kRim = 0.2;
    if (left > kRim && right < 1 - kRim && top > kRim && bottom < 1 - kRim) return "the middle";
    return {};
  }

 private:
  static constexpr int kCells = 10;

  // Least and greatest median.
  static std::pair<double, double> RangeOfMedians(
      const std::map<int, std::vector<double>>& images) {
    std::vector<double> medians;
    medians.reserve(images.size());
    for (const auto& [frame, values] : images) medians.push_back(Median(values));
    const auto [least, greatest] = std::minmax_element(medians.begin(), medians.end());
    return {*least, *greatest};
  }

  void MeasureTilt(const CalibrationRecord& calibration,
                   const std::map<int, RigidTransform>& poses) {
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const auto& [number, marker] : calibration.markers) mean += marker.position;
    mean /= static_cast<double>(calibration.markers.size());
    Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
    for (const auto& [number, marker] : calibration.markers) {
      const Eigen::Vector3d d = marker.position - mean;
      scatter += d * d.transpose();
    }
    const SymmetricEigen3 axes = DecomposeSymmetric(scatter);
    constexpr double kThin = 0.05;  // thickness over width of what still counts as a plane
    is_plane = std::sqrt(std::max(0.0, axes.values[0])) <= kThin * std::sqrt(axes.values[1]);
    const Eigen::Vector3d normal = axes.vectors.col(0);
    std::vector<Eigen::Vector3d> turned;
    Eigen::Vector3d sum = Eigen::Vector3d::Zero();
    for (const auto& [frame, T] : poses) {
      turned.emplace_back(is_plane ? Eigen::Vector3d(T.R * normal) : T.R.row(2).transpose());
      // The same face in every image.
      if (is_plane && turned.back().dot(T * mean) < 0) turned.back() = -turned.back();
      sum += turned.back();
    }
    double least_cosine = 1;
    for (const Eigen::Vector3d& a : turned) {
      for (const Eigen::Vector3d& b : turned) least_cosine = std::min(least_cosine, a.dot(b));
    }
    tilt = kDegrees * std::acos(std::max(least_cosine, -1.0));
    lean = kDegrees * std::acos(std::clamp(sum.normalized().z(), -1.0, 1.0));
  }

  void FindEmptyParts(const ImageGrid& grid, const std::vector<bool>& seen) {
    constexpr std::array kNames{"upper left corner",
                                "upper edge",
                                "upper right corner",
                                "left edge",
                                "middle",
                                "right edge",
                                "lower left corner",
                                "lower edge",
                                "lower right corner"};
    std::array<bool, kNames.size()> any_seen{};
    for (size_t cell = 0; cell < seen.size(); ++cell) {
      const auto columns = static_cast<size_t>(grid.Columns()),
                 rows = static_cast<size_t>(grid.Rows());
      const size_t row = cell / columns, column = cell % columns;
      if (seen[cell]) any_seen[3 * (3 * row / rows) + 3 * column / columns] = true;
    }
    for (size_t part = 0; part < kNames.size(); ++part) {
      if (!any_seen[part]) empty.emplace_back(kNames[part]);
    }
  }
};

class Judgement {
 public:
  explicit Judgement(const CalibrationRecord& calibration) : calibration_(calibration) {}

  Verdict Make(const std::vector<std::vector<ProjectionMap>>& maps) {
    std::vector<bool> is_projection_good;
    for (size_t c = 0; c < calibration_.cameras.size(); ++c) {
      JudgePoses(c);
      JudgeResiduals(calibration_.cameras[c]);
      is_projection_good.push_back(!maps[c].empty() &&
                                   JudgeProjection(calibration_.cameras[c], maps[c]));
    }
    for (const WeakUnknowns& weak : calibration_.weak) JudgeUnknowns(weak, is_projection_good);
    JudgeConvergence();
    for (const std::string& warning : calibration_.warnings) {
      // JudgeConvergence reports it, with a worse grade.
      if (warning.starts_with("the bundle adjustment did not converge")) continue;
      Add(Grade::kWeak, warning, "");
    }
    std::stable_sort(verdict_.findings.begin(),
                     verdict_.findings.end(),
                     [](const auto& a, const auto& b) { return a.grade > b.grade; });
    if (!verdict_.findings.empty()) verdict_.grade = verdict_.findings.front().grade;
    verdict_.headline = verdict_.grade == Grade::kGood ? "This calibration is good."
                        : verdict_.grade == Grade::kWeak
                            ? "This calibration can be used, but it has weak points."
                            : "Do not rely on this calibration.";
    return std::move(verdict_);
  }

 private:
  void Add(Grade grade, std::string what, std::string remedy) {
    verdict_.findings.push_back({grade, std::move(what), std::move(remedy)});
  }

  // After undetermined parameters, along which the adjustment moves without end.
  void JudgeConvergence() {
    if (calibration_.adjustment && calibration_.adjustment->converged) return;
    const bool is_open = std::ranges::any_of(calibration_.weak, &WeakUnknowns::open);
    Add(Grade::kBad,
        "The bundle adjustment did not converge; no figure here can be relied on.",
        is_open
            ? "It moves along directions that the images do not determine; fix these first."
            : "Give a better initial guess ('initial'), or look for images with wrong detections.");
  }

  // Strongly correlated parameters do no harm where the projection is certain.
  void JudgeUnknowns(const WeakUnknowns& weak, const std::vector<bool>& is_projection_good) {
    bool is_harmless = !weak.open;
    for (const std::string& name : weak.names) {
      for (size_t c = 0; c < calibration_.cameras.size(); ++c) {
        const std::string prefix = calibration_.cameras[c].name + ".";
        if (!name.starts_with(prefix)) continue;
        is_harmless &= is_projection_good[c] && !name.starts_with(prefix + "T_camera_rig");
      }
    }
    const std::string what = weak.what.empty() ? "" : ": " + weak.what;
    Add(is_harmless  ? Grade::kGood
        : !weak.open ? Grade::kWeak
                     : Grade::kBad,
        fmt::format("{} determined by these images: {}{}.{}",
                    weak.open ? "Not" : "Weakly",
                    Listed(weak.names),
                    what,
                    is_harmless ? " The projection is certain nevertheless." : ""),
        weak.remedy.empty() ? "Add images from other distances and at other tilts, over the whole "
                              "image, or fix these parameters ('fixed')."
                            : weak.remedy);
  }

  void JudgePoses(size_t c) {
    const CalibratedCamera& camera = calibration_.cameras[c];
    const PoseSpread spread(calibration_, c);
    if (!spread.any) {
      Add(Grade::kBad, camera.name + ": no point of this camera was used.", "");
      return;
    }
    if (camera.fit.views < kViewsWeak) {
      Add(camera.fit.views < kViewsBad ? Grade::kBad : Grade::kWeak,
          fmt::format("{}: only {} image{} with the target.",
                      camera.name,
                      camera.fit.views,
                      camera.fit.views == 1 ? "" : "s"),
          "Take twenty or more, each from another place.");
    }
    if (spread.coverage < kCoverageWeak) {
      const std::string region = spread.Region();
      Add(spread.coverage < kCoverageBad ? Grade::kBad : Grade::kWeak,
          region.empty()
              ? fmt::format("{}: the points cover only {:.0f} % of the image{}{}.",
                            camera.name,
                            100 * spread.coverage,
                            spread.empty.empty() ? "" : "; none in: ",
                            fmt::join(spread.empty, ", "))
              : fmt::format("{}: points only in {} of the image; they cover {:.0f} % of it.",
                            camera.name,
                            region,
                            100 * spread.coverage),
          "Elsewhere the distortion is extrapolated. Take images with the target in the other parts of "
          "the image, its edges and corners above all.");
    }
    // A 3D target shows depth and tilt in a single image: reported, but no weakness by itself.
    const char* const makes_up =
        spread.is_plane ? "" : " The target's own depth has to compensate for it.";
    const auto grade = [&](Grade of_plane) { return spread.is_plane ? of_plane : Grade::kGood; };
    const double span = spread.farthest / spread.nearest;
    if (span < kDepthWeak) {
      const bool one = span < kDepthOne;
      Add(grade(one && spread.tilt < kTiltWeak ? Grade::kBad : Grade::kWeak),
          fmt::format("{}: {} ({} to {}).{}",
                      camera.name,
                      one ? "all images are from one distance" : "the distances hardly differ",
                      Length(spread.nearest),
                      Length(spread.farthest),
                      makes_up),
          "Take images from near, where the target fills the image, to at least twice as far.");
    }
    if (spread.tilt < kTiltWeak) {
      const bool none = spread.tilt < kTiltBad;
      Add(grade(none ? Grade::kBad : Grade::kWeak),
          fmt::format("{}: {} (by at most {:.0f} degrees between two images{}).{}",
                      camera.name,
                      none ? "the target was not tilted" : "the target was hardly tilted",
                      spread.tilt,
                      !spread.is_plane         ? ""
                      : spread.lean < kTiltBad ? ", it always faces the camera"
                                               : ", it always leans the same way",
                      makes_up),
          spread.is_plane ? "Tilt the target by 30 to 45 degrees to the left, the right, up and "
                            "down: without tilt focal length and distance cannot be told apart."
                          : "");
    }
  }

  void JudgeResiduals(const CalibratedCamera& camera) {
    if (camera.fit.detector_sigma > 0 &&
        camera.fit.noise_sigma > kNoiseWeak * camera.fit.detector_sigma) {
      Add(Grade::kWeak,
          fmt::format(
              "{}: the residuals ({:.3g} px per coordinate) are {:.1f} times the noise that "
              "the detector states ({:.3g} px).",
              camera.name,
              camera.fit.noise_sigma,
              camera.fit.noise_sigma / camera.fit.detector_sigma,
              camera.fit.detector_sigma),
          "The excess is an error of the camera model, of the target or motion: try a "
          "model with more distortion terms, 'refine_target', a flatter target, a still camera.");
    }
    const int all = camera.fit.points + camera.fit.rejected;
    if (camera.fit.rejected > kRejectedWeak * all) {
      Add(Grade::kWeak,
          fmt::format("{}: {} of {} points were rejected as outliers ({:.0f} %).",
                      camera.name,
                      camera.fit.rejected,
                      all,
                      100.0 * camera.fit.rejected / all),
          "Look at the images and markers with the most rejected points below.");
    }
    // Mean residuals in cells of the image, beyond their noise.
    const ResidualField field = FieldOf(camera);
    double pattern = 0, points = 0;
    for (size_t cell = 0; cell < field.grid.Cells(); ++cell) {
      const double n = field.points[cell];
      pattern += n * (field.mean[cell].squaredNorm() / 2 - field.variance_of_mean[cell]);
      points += n;
    }
    pattern = points > 0 ? std::sqrt(std::max(0.0, pattern / points)) : 0;
    if (camera.fit.noise_sigma > 0 && pattern > kPatternWeak * camera.fit.noise_sigma) {
      Add(Grade::kWeak,
          fmt::format("{}: the residuals have a pattern over the image of {:.3g} px, {:.0f} % of "
                      "the noise.",
                      camera.name,
                      pattern,
                      100 * pattern / camera.fit.noise_sigma),
          "The camera model does not quite fit this lens; try one with more distortion terms.");
    }
  }

  // True when the projection is certain nearly everywhere in the image.
  bool JudgeProjection(const CalibratedCamera& camera, const std::vector<ProjectionMap>& maps) {
    const ProjectionMap& map = maps[1];  // at the median distance
    int known = 0, poor = 0;
    double worst = 0;
    Eigen::Vector2d where(0, 0);
    for (size_t cell = 0; cell < map.sigma.size(); ++cell) {
      if (std::isnan(map.sigma[cell])) continue;
      ++known;
      poor += map.sigma[cell] > camera.fit.noise_sigma ? 1 : 0;
      if (map.sigma[cell] <= worst) continue;
      worst = map.sigma[cell];
      where = map.grid.Middle(cell);
    }
    constexpr double kPoorPart = 0.1;
    if (poor <= kPoorPart * known) return known > 0;
    Add(poor > 0.5 * known ? Grade::kBad : Grade::kWeak,
        fmt::format("{}: in {:.0f} % of the image the projection of a point {} away is more "
                    "uncertain than one measured point ({:.2g} px); worst, at ({:.0f}, {:.0f}), "
                    "{:.2g} px.",
                    camera.name,
                    100.0 * poor / known,
                    Length(map.distance),
                    camera.fit.noise_sigma,
                    where.x(),
                    where.y(),
                    worst),
        "Add images with the target there.");
    return false;
  }

  const CalibrationRecord& calibration_;
  Verdict verdict_;
};

}  // namespace

Verdict Judge(const CalibrationRecord& calibration,
              const std::vector<std::vector<ProjectionMap>>& maps) {
  return Judgement(calibration).Make(maps);
}

}  // namespace plenocal
