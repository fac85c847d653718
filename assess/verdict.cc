// SPDX-License-Identifier: Apache-2.0
#include "assess/verdict.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <set>

#include "assess/pose_spread.h"
#include "assess/projection_map.h"
#include "assess/residual_field.h"
#include "calib/base/statistics.h"
#include "calib/estimate/weak_unknowns.h"

namespace plenocal {
namespace {

// Errors of the projection, px. Whoever measures in images takes a tenth of a pixel for exact; an
// error of a pixel is larger than any detector's. Between them a projection that is as certain as
// one measured point suffices, up to half a pixel.
constexpr double kExactProjection = 0.1, kPoint = 0.5, kWholePixelError = 1;
// At ten times the farthest point: focal length or centre is not known.
constexpr double kFarBad = 3;
// Noise beyond this many times the detector's has another cause.
constexpr double kNoiseRatio = 2;
// Residuals of points whose detector states no sigma, px: corners of chessboards by hand have 0.5.
constexpr double kUnstatedNoise = 1;
// Pattern of the residuals over noise; below it, it does not stand out.
constexpr double kPatternRatio = 0.3;
// Of a whole image an even spread of poses fills nearly all; a fisheye lens leaves its corners dark
// (1 - pi / 4).
constexpr double kCoverageUsable = 0.7, kCoverageBad = 0.3;
// Margin without points, part of width or height: from 0.6 of the half width to its end a term r^5
// grows by a factor of 13.
constexpr double kMargin = 0.2;
// Perspective of a plane turned by a few degrees drowns in its distance: d(1/z) ~ tilt.
constexpr double kTiltWeak = 30, kTiltNone = 12;  // degrees
// Farthest over nearest image.
constexpr double kDepthWeak = 1.5, kDepthOne = 1.15;
// Each view of a plane gives two equations on the intrinsics; the rest is redundancy.
constexpr int kViewsUsable = 10, kViewsBad = 3;
constexpr double kRejected = 0.05;  // part of the points
// Parts of the image along its longer side, and frames that have rejected points in one: a wrong
// image has them in a single frame.
constexpr int kPartCells = 8;
constexpr size_t kFewestPartFrames = 3;

std::string LengthText(double metres) {
  return metres < 1 ? fmt::format("{:.3g} mm", 1e3 * metres) : fmt::format("{:.3g} m", metres);
}

bool ShareACamera(const Finding& a, const Finding& b) {
  if (a.cameras.empty() || b.cameras.empty()) return true;
  return std::ranges::any_of(a.cameras, [&](const std::string& name) {
    return std::ranges::find(b.cameras, name) != b.cameras.end();
  });
}

// Noise beyond the detector's, px; all of it where the detector states none.
double ExcessOf(const CameraFit& fit) {
  return std::sqrt(
      std::max(0.0, fit.noise_sigma * fit.noise_sigma - fit.detector_sigma * fit.detector_sigma));
}

bool IsNoiseLarge(const CameraFit& fit) {
  return fit.detector_sigma > 0 ? fit.noise_sigma > kNoiseRatio * fit.detector_sigma
                                : fit.noise_sigma > kUnstatedNoise;
}

// Pattern of the residuals over the image, px: what the model gets wrong there. 0 where it does not
// stand out of the noise.
double PatternOf(const CalibratedCamera& camera) {
  const double pattern = MakeResidualField(camera).Pattern(), noise = camera.fit.noise_sigma;
  return noise > 0 && pattern > kPatternRatio * noise ? pattern : 0;
}

// A figure of `Certainty`: not a number where the lens forms no image.
std::string PixelsText(double pixels) {
  return std::isnan(pixels) ? "no image" : fmt::format("{:.2g} px", pixels);
}

/// Figures of one map of the projection's error, px.
struct Certainty {
  double distance = 0;             // m
  double centre = 0, corners = 0;  // corners: the mean square of the four outermost cells
  double most = 0;                 // what `kMostOfImage` keeps
  double worst = 0;
  Eigen::Vector2d where{0, 0};  // of the worst
};

/// `systematic`: error besides the map's sigma, the same everywhere.
Certainty Summarise(ProjectionMap map, double systematic) {
  Certainty figures{.distance = map.distance, .most = map.Most(systematic)};
  for (size_t cell = 0; cell < map.sigma.size(); ++cell) {
    map.sigma[cell] = std::hypot(map.sigma[cell], systematic);
    if (!(map.sigma[cell] > figures.worst)) continue;
    figures.worst = map.sigma[cell];
    figures.where = map.grid.Middle(cell);
  }
  const auto columns = static_cast<size_t>(map.grid.Columns()),
             rows = static_cast<size_t>(map.grid.Rows());
  figures.centre = map.sigma[rows / 2 * columns + columns / 2];
  double squares = 0, count = 0;
  for (const size_t cell : {size_t{0}, columns - 1, (rows - 1) * columns, rows * columns - 1}) {
    if (std::isnan(map.sigma[cell])) continue;
    squares += map.sigma[cell] * map.sigma[cell];
    ++count;
  }
  figures.corners = count > 0 ? std::sqrt(squares / count) : std::nan("");
  return figures;
}

/// What other findings need of a camera's projection.
struct Projection {
  Grade grade = Grade::kGood;
  bool known = true;           // its standard error is finite
  bool knows_corners = false;  // their standard error is within the limit
};

class Judgement {
 public:
  explicit Judgement(const CalibrationRecord& calibration) : calibration_(calibration) {}

  Verdict Make() {
    verdict_.findings = calibration_.findings;
    for (size_t c = 0; c < calibration_.cameras.size(); ++c) {
      const double pattern = PatternOf(calibration_.cameras[c]);
      projections_.push_back(
          JudgeProjection(c, std::hypot(pattern, Disagreement(calibration_.cameras[c].name))));
      JudgePoses(c, projections_.back());
      JudgeNoise(calibration_.cameras[c]);
      JudgePattern(calibration_.cameras[c], pattern);
      JudgeRejectedParts(calibration_.cameras[c]);
    }
    for (const WeakUnknowns& weak : calibration_.weak) JudgeUnknowns(weak);
    JudgeConvergence();
    MergeCameras();
    ApplyCauses();
    SortFindings();
    if (!verdict_.findings.empty()) verdict_.grade = verdict_.findings.front().grade;
    return std::move(verdict_);
  }

 private:
  void Add(Finding finding) { verdict_.findings.push_back(std::move(finding)); }

  void AddTo(const CalibratedCamera& camera, Finding finding) {
    finding.cameras = {camera.name};
    finding.what.insert(0, camera.name + ": ");
    Add(std::move(finding));
  }

  // After undetermined parameters, along which the adjustment moves without end.
  void JudgeConvergence() {
    if (!calibration_.adjustment || calibration_.adjustment->converged) return;
    const bool is_open = std::ranges::any_of(calibration_.weak, &WeakUnknowns::open);
    Add({.code = "not_converged",
         .grade = Grade::kBad,
         .what = "The bundle adjustment did not converge; no figure here can be relied on.",
         .remedy = is_open
                       ? "It moves along directions that the images do not determine; fix these "
                         "first."
                       : "Give a better initial guess ('initial'), or look for images with wrong "
                         "detections."});
  }

  // What open and weak intrinsics do to the projection is graded there: coefficients of a rich
  // model replace each other. Extrinsics, and the depth of a plenoptic camera, have no other
  // figure.
  Grade GradeOfUnknown(size_t c, const std::string& name, bool open) const {
    const CalibratedCamera& camera = calibration_.cameras[c];
    if (name.starts_with(camera.name + ".T_camera_rig")) {
      return open ? Grade::kBad : Grade::kUsable;
    }
    if (!open) return Grade::kGood;
    return projections_[c].known && !camera.model->plenoptic ? projections_[c].grade : Grade::kBad;
  }

  void JudgeUnknowns(const WeakUnknowns& weak) {
    Grade grade = Grade::kGood;
    std::vector<std::string> cameras;
    for (const std::string& name : weak.names) {
      for (size_t c = 0; c < calibration_.cameras.size(); ++c) {
        const std::string& camera = calibration_.cameras[c].name;
        if (!name.starts_with(camera + ".")) continue;
        if (cameras.empty() || cameras.back() != camera) cameras.push_back(camera);
        grade = std::max(grade, GradeOfUnknown(c, name, weak.open));
      }
    }
    Add({.code = weak.open ? "undetermined" : "weakly_determined",
         .grade = grade,
         .cameras = std::move(cameras),
         .what = fmt::format("{} determined by these images: {}{}{}.{}",
                             weak.open ? "Not" : "Weakly",
                             Listed(weak.names),
                             weak.what.empty() ? "" : ": ",
                             weak.what,
                             weak.open && grade == Grade::kGood
                                 ? " These parameters replace each other: the projection is "
                                   "certain all the same."
                                 : ""),
         .remedy =
             weak.remedy.empty()
                 ? "Add images from other distances and at other tilts, over the whole image, "
                   "or fix these parameters ('fixed')."
                 : weak.remedy});
  }

  // Difference between the camera models that predict held-out frames equally well, px.
  double Disagreement(const std::string& camera) const {
    for (const Finding& finding : calibration_.findings) {
      if (finding.code == "automatic_choice" && finding.value &&
          std::ranges::find(finding.cameras, camera) != finding.cameras.end()) {
        return *finding.value;
      }
    }
    return 0;
  }

  // Accuracy of a camera in use: the error of its projection over the whole image, by chance and by
  // the model.
  Projection JudgeProjection(size_t c, double systematic) {
    const CalibratedCamera& camera = calibration_.cameras[c];
    const std::vector<ProjectionMap> maps = ProjectionMaps(calibration_, c);
    if (maps.empty()) return {.grade = Grade::kBad, .known = false};  // `JudgeUnknowns`
    const Certainty here = Summarise(maps[1], systematic), far = Summarise(maps[3], systematic);
    const double limit = std::clamp(camera.fit.noise_sigma, kExactProjection, kPoint);
    const Grade grade = here.most > kWholePixelError || far.most > kFarBad ? Grade::kBad
                        : here.most > limit || far.most > kWholePixelError ? Grade::kUsable
                                                                           : Grade::kGood;
    AddTo(camera,
          {.code = "projection",
           .follows_from_noise = true,
           .grade = grade,
           .value = here.most,
           .limit = grade == Grade::kBad ? kWholePixelError : limit,
           .what = fmt::format(
               "{} at {}: {} in the middle, {} in the corners, "
               "at most {:.2g} px in {:.0f} % of the image (worst {:.2g} px at ({:.0f}, "
               "{:.0f})); at {}: {}.",
               systematic > 0 ? "error of the projection (standard error, error of the model)"
                              : "standard error of the projection",
               LengthText(here.distance),
               PixelsText(here.centre),
               PixelsText(here.corners),
               here.most,
               100 * kMostOfImage,
               here.worst,
               here.where.x(),
               here.where.y(),
               LengthText(far.distance),
               PixelsText(far.most)),
           .remedy =
               grade == Grade::kGood ? ""
               : calibration_.HasScene()
                   ? "Add frames, and points where it is largest and at other distances."
                   : "Add images with the target where it is largest, and from other distances."});
    return {.grade = grade, .knows_corners = here.corners <= limit};
  }

  void JudgePoses(size_t c, const Projection& projection) {
    const CalibratedCamera& camera = calibration_.cameras[c];
    const PoseSpread spread = MeasurePoseSpread(calibration_, c);
    if (!spread.any) {
      if (camera.residuals.empty() && camera.fit.points > 0) return;  // the tables are not at hand
      AddTo(
          camera,
          {.code = "no_points", .grade = Grade::kBad, .what = "no point of this camera was used."});
      return;
    }
    if (camera.fit.views < kViewsUsable) {
      const bool bad = camera.fit.views < kViewsBad && spread.is_plane;
      AddTo(camera,
            {.code = "few_images",
             .role = FindingRole::kCause,
             .grade = bad ? Grade::kBad : Grade::kUsable,
             .value = camera.fit.views,
             .limit = bad ? kViewsBad : kViewsUsable,
             .what = fmt::format("only {} image{}{}.",
                                 camera.fit.views,
                                 camera.fit.views == 1 ? "" : "s",
                                 calibration_.HasScene() ? "" : " with the target"),
             .remedy = "Take twenty or more, each from another position."});
    }
    JudgeSupport(camera, spread, projection);
    if (calibration_.HasScene()) return;  // its depths and the path have findings of their own
    JudgeDistances(camera, spread, projection.grade);
    JudgeTilt(camera, spread, projection.grade);
  }

  void JudgeSupport(const CalibratedCamera& camera,
                    const PoseSpread& spread,
                    const Projection& projection) {
    const std::string region = spread.Region();
    const bool little = spread.coverage < kCoverageUsable;
    if (!little && spread.Margin() < kMargin) return;
    const bool bad = spread.coverage < kCoverageBad;
    if (!bad && projection.knows_corners) return;
    AddTo(camera,
          {.code = little ? "coverage" : "coverage_margin",
           .grade = bad ? Grade::kBad : Grade::kUsable,
           .value = little ? spread.coverage : spread.Margin(),
           .limit = bad      ? kCoverageBad
                    : little ? kCoverageUsable
                             : kMargin,
           .what = !little ? fmt::format("no points in a margin of {:.0f} % of the image.",
                                         100 * spread.Margin())
                   : region.empty()
                       ? fmt::format("the points cover only {:.0f} % of the image{}{}.",
                                     100 * spread.coverage,
                                     spread.empty.empty() ? "" : "; none in: ",
                                     fmt::join(spread.empty, ", "))
                       : fmt::format("points only in {} of the image; they cover {:.0f} % of it.",
                                     region,
                                     100 * spread.coverage),
           .remedy =
               fmt::format("Elsewhere the distortion is extrapolated. Take images with {} in the "
                           "other parts of the image, its edges and corners above all.",
                           calibration_.HasScene() ? "points" : "the target")});
  }

  // A 3D target shows depth and tilt in a single image, and what a plane lacks does no harm where
  // the projection is certain: reported, but no defect by itself. Without any tilt that certainty
  // rests on the distortion model alone, which no lens follows exactly.
  static Grade GradeOf(const PoseSpread& spread, Grade projection) {
    if (!spread.is_plane) return Grade::kGood;
    return projection != Grade::kGood || spread.tilt < kTiltNone ? Grade::kUsable : Grade::kGood;
  }

  void JudgeDistances(const CalibratedCamera& camera, const PoseSpread& spread, Grade projection) {
    const double span = spread.farthest / spread.nearest;
    if (span >= kDepthWeak) return;
    const bool one = span < kDepthOne;
    AddTo(
        camera,
        {.code = one ? "one_distance" : "few_distances",
         .role = one ? FindingRole::kOpenPoses : FindingRole::kConsequence,
         .grade = GradeOf(spread, projection),
         .value = span,
         .limit = one ? kDepthOne : kDepthWeak,
         .what =
             fmt::format("{} ({} to {}).{}",
                         one ? "all images are from one distance" : "the distances hardly differ",
                         LengthText(spread.nearest),
                         LengthText(spread.farthest),
                         spread.is_plane ? "" : kMakesUp),
         .remedy = "Take images from near, where the target fills the image, to at least twice as "
                   "far."});
  }

  void JudgeTilt(const CalibratedCamera& camera, const PoseSpread& spread, Grade projection) {
    if (spread.tilt >= kTiltWeak) return;
    const bool none = spread.tilt < kTiltNone;
    AddTo(
        camera,
        {.code = none ? "no_tilt" : "little_tilt",
         .role = none ? FindingRole::kOpenPoses : FindingRole::kConsequence,
         .grade = GradeOf(spread, projection),
         .value = spread.tilt,
         .limit = none ? kTiltNone : kTiltWeak,
         .what = fmt::format("{} (by at most {:.0f} degrees between two images{}).{}",
                             none ? "the target was not tilted" : "the target was hardly tilted",
                             spread.tilt,
                             !spread.is_plane          ? ""
                             : spread.lean < kTiltNone ? ", it always faces the camera"
                                                       : ", it always leans the same way",
                             spread.is_plane ? "" : kMakesUp),
         .remedy = spread.is_plane
                       ? "Tilt the target by 30 to 45 degrees to the left, the right, up and down: "
                         "without tilt focal length and distance cannot be told apart."
                       : ""});
  }

  void JudgeNoise(const CalibratedCamera& camera) {
    const CameraFit& fit = camera.fit;
    const bool stated = fit.detector_sigma > 0;
    const double excess = ExcessOf(fit);
    // Without a stated sigma all noise may be the detector's.
    const double usable = stated ? kPoint : kUnstatedNoise;
    const double bad = stated ? kWholePixelError : 3 * kUnstatedNoise;
    if (IsNoiseLarge(fit)) {
      const Grade grade = excess > bad      ? Grade::kBad
                          : excess > usable ? Grade::kUsable
                                            : Grade::kGood;
      AddTo(camera,
            {.code = "noise_excess",
             .follows_from_noise = true,
             .grade = grade,
             .value = excess,
             .limit = grade == Grade::kBad ? bad : usable,
             .what = stated ? fmt::format("the residuals ({:.3g} px per coordinate) are {:.1f} "
                                          "times the noise that the detector states ({:.3g} px).",
                                          fit.noise_sigma,
                                          fit.noise_sigma / fit.detector_sigma,
                                          fit.detector_sigma)
                            : fmt::format("the residuals are large, {:.3g} px per coordinate.",
                                          fit.noise_sigma),
             .remedy =
                 "The excess is an error of the camera model, of the target or motion: try a "
                 "model with more distortion terms ('plenocal try'), 'refine_target', a flatter "
                 "target, a still camera."});
    }
    const int all = fit.points + fit.rejected;
    if (fit.rejected <= kRejected * all) return;
    AddTo(
        camera,
        {.code = "many_outliers",
         .follows_from_noise = true,
         .grade = Grade::kUsable,
         .value = static_cast<double>(fit.rejected) / all,
         .limit = kRejected,
         .what = fmt::format("{} of {} points were rejected as outliers ({:.0f} %).",
                             fit.rejected,
                             all,
                             100.0 * fit.rejected / all),
         .remedy = "Look at the images and markers with the most rejected points in the report."});
  }

  // Points of several frames that are rejected where few others are, are no outliers.
  void JudgeRejectedParts(const CalibratedCamera& camera) {
    const ImageGrid grid(camera.image_size, kPartCells);
    struct Part {
      std::vector<double> rejected;  // lengths of residuals, px
      std::set<int> frames;          // with rejected points
      size_t used = 0;
    };
    std::vector<Part> parts(grid.Cells());
    for (const ResidualRow& row : camera.residuals) {
      Part& part = parts[grid.Cell(row.values[0], row.values[1])];
      if (row.used) {
        ++part.used;
      } else {
        part.rejected.push_back(row.Error().norm());
        part.frames.insert(row.frame);
      }
    }
    size_t points = 0;
    std::vector<std::string> places;
    std::vector<double> lengths;
    for (size_t cell = 0; cell < parts.size(); ++cell) {
      const Part& part = parts[cell];
      if (part.frames.size() < kFewestPartFrames || part.rejected.size() <= part.used) continue;
      const Eigen::Vector2d middle = grid.Middle(cell);
      places.push_back(fmt::format("({:.0f}, {:.0f})", middle.x(), middle.y()));
      lengths.insert(lengths.end(), part.rejected.begin(), part.rejected.end());
      points += part.used + part.rejected.size();
    }
    if (places.empty()) return;
    const double error = Median(lengths);
    AddTo(camera,
          {.code = "rejected_part",
           .grade = error > kWholePixelError ? Grade::kUsable : Grade::kGood,
           .value = error,
           .limit = kWholePixelError,
           .what = fmt::format("{} of {} points were rejected around {}, in several frames: they "
                               "are no outliers; the camera model is wrong there, by {:.2g} px.",
                               lengths.size(),
                               points,
                               fmt::join(places, ", "),
                               error),
           .remedy = "Try a model with more distortion terms ('plenocal try'), or take more images "
                     "with the target there."});
  }

  void JudgePattern(const CalibratedCamera& camera, double pattern) {
    if (pattern == 0) return;
    const Grade grade = pattern > kWholePixelError   ? Grade::kBad
                        : pattern > kExactProjection ? Grade::kUsable
                                                     : Grade::kGood;
    AddTo(camera,
          {.code = "residual_pattern",
           .grade = grade,
           .value = pattern,
           .limit = grade == Grade::kBad ? kWholePixelError : kExactProjection,
           .what = fmt::format("the residuals have a pattern over the image of {:.3g} px ({:.0f} "
                               "% of the noise){}.",
                               pattern,
                               100 * pattern / camera.fit.noise_sigma,
                               grade == Grade::kGood ? "; it is small in use" : ""),
           .remedy = "The camera model does not quite fit this lens; try one with more distortion "
                     "terms ('plenocal try')."});
  }

  // The same finding of several cameras is one: their texts follow each other.
  void MergeCameras() {
    std::vector<Finding> merged;
    for (Finding& finding : verdict_.findings) {
      const auto same = std::ranges::find_if(merged, [&](const Finding& other) {
        return other.code == finding.code && other.grade == finding.grade &&
               other.remedy == finding.remedy && !other.cameras.empty() && !finding.cameras.empty();
      });
      if (same == merged.end()) {
        merged.push_back(std::move(finding));
        continue;
      }
      same->cameras.insert(same->cameras.end(), finding.cameras.begin(), finding.cameras.end());
      same->what.append(" ").append(finding.what);
      if (same->value && finding.value && same->limit) {
        const bool above = *same->value > *same->limit;
        if (above ? *finding.value > *same->value : *finding.value < *same->value) {
          same->value = finding.value;
          same->limit = finding.limit;
        }
      }
    }
    verdict_.findings = std::move(merged);
  }

  static bool IsCause(const Finding& finding) {
    return finding.grade != Grade::kGood && finding.role >= FindingRole::kCause;
  }

  static bool CanExplain(const Finding& cause, const Finding& other) {
    if (IsCause(other) || other.role == FindingRole::kImageDefect) return false;
    return cause.role == FindingRole::kImageDefect ? other.follows_from_noise : IsCause(cause);
  }

  // Moves causes in front of their consequences and of what is no cause; the order stays otherwise.
  void SortFindings() {
    // Poses that the images leave undetermined disagree between the cameras of a rig as well.
    const bool open_poses = std::ranges::any_of(verdict_.findings, [&](const Finding& finding) {
      return IsCause(finding) && finding.role == FindingRole::kOpenPoses;
    });
    const auto rank = [&](const Finding& finding) {
      const FindingRole role = finding.role;
      if (IsCause(finding) && !(open_poses && role == FindingRole::kRigCause)) return 3;
      return role == FindingRole::kImageDefect ? 2 : role == FindingRole::kOutlier ? 1 : 0;
    };
    std::ranges::stable_sort(verdict_.findings, [&](const Finding& a, const Finding& b) {
      return std::pair(a.grade, rank(a)) > std::pair(b.grade, rank(b));
    });
  }

  // A cause has the grade of its worst consequence; with a wrong target no remedy of these helps.
  void ApplyCauses() {
    for (Finding& cause : verdict_.findings) {
      const bool wrong_target =
          cause.role == FindingRole::kTargetCause && cause.grade == Grade::kBad;
      for (Finding& other : verdict_.findings) {
        if (!CanExplain(cause, other) || !ShareACamera(cause, other)) continue;
        cause.grade = std::max(cause.grade, other.grade);
        if (wrong_target) other.remedy.clear();
      }
    }
  }

  static constexpr const char* kMakesUp = " The target's own depth has to compensate for it.";

  const CalibrationRecord& calibration_;
  std::vector<Projection> projections_;  // by camera
  Verdict verdict_;
};

}  // namespace

bool HasUnexplainedResiduals(const CalibratedCamera& camera) {
  return (IsNoiseLarge(camera.fit) && ExcessOf(camera.fit) > kExactProjection) ||
         PatternOf(camera) > kExactProjection;
}

Verdict Judge(const CalibrationRecord& calibration) { return Judgement(calibration).Make(); }

std::string Headline(const Verdict& verdict) {
  switch (verdict.grade) {
    case Grade::kGood:
      return "This calibration is good.";
    case Grade::kUsable:
      return "This calibration can be used, but it has weak points.";
    case Grade::kBad:
      return "Do not rely on this calibration.";
  }
  return {};
}

std::string FindingText(const Finding& finding) {
  const std::string text =
      finding.grade == Grade::kGood
          ? fmt::format("{}\n", finding.what)
          : fmt::format("{} [{}] {}\n", GradeName(finding.grade), finding.code, finding.what);
  return finding.remedy.empty() ? text : text + fmt::format("    {}\n", finding.remedy);
}

std::string VerdictText(const Verdict& verdict) {
  std::string text;
  // Clang 14 has no std::views::reverse. NOLINTNEXTLINE(modernize-loop-convert)
  for (auto finding = verdict.findings.rbegin(); finding != verdict.findings.rend(); ++finding) {
    // Good findings stand in the report alone, but for these. Parameters that are open without
    // effect are a detail of a good calibration.
    static constexpr std::array<std::string_view, 4> kAlwaysShown{
        "projection", "points_share_errors", "automatic_choice", "target_size_unknown"};
    const bool is_always_shown =
        std::ranges::find(kAlwaysShown, finding->code) != kAlwaysShown.end();
    const bool is_open = finding->code == "undetermined" || finding->code == "weakly_determined";
    if (finding->grade != Grade::kGood || is_always_shown ||
        (is_open && verdict.grade != Grade::kGood)) {
      text += FindingText(*finding);
    }
  }
  return text + fmt::format("verdict: {}. {}\n", GradeName(verdict.grade), Headline(verdict));
}

}  // namespace plenocal
