// SPDX-License-Identifier: Apache-2.0
#include "engine/observe/choose_frames.h"

#include <fmt/format.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "assess/frames/frame_selection.h"
#include "calib/base/error.h"
#include "calib/base/parallel.h"
#include "calib/base/quoted_text.h"
#include "calib/base/statistics.h"
#include "calib/estimate/calibrate.h"
#include "calib/estimate/describe.h"
#include "calib/files/exclusion.h"
#include "calib/start/camera_guess.h"
#include "detectors/detect.h"
#include "engine/session/calibration_input.h"
#include "engine/suggest/view_target.h"

namespace plenocal {
namespace {

constexpr size_t kUsualFrames = 100, kFewFrames = 200;
constexpr size_t kCandidates = 5;    // times as many frames as are wanted enter the choice by gain
constexpr size_t kFirstFrames = 30;  // of the calibration that the gain is computed with
constexpr size_t kFewestPoints = 6;  // for a pose with redundancy
constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();

/// One instant.
struct Instant {
  std::string name;
  std::vector<std::optional<size_t>> image;   // per camera
  double motion = kUnknown, blur = kUnknown;  // px, the largest of its cameras
  size_t points = 0;
  std::string reason;  // why it is left out; empty: it is chosen
};

size_t CountFrames(const std::vector<CameraImages>& cameras) {
  std::set<std::string> frames;
  for (const CameraImages& camera : cameras) {
    for (const FrameImage& image : camera.images) frames.insert(image.frame);
  }
  return frames.size();
}

/// The number of frames to keep; nothing: all.
std::optional<size_t> WantedFrames(const Session& session,
                                   const std::vector<CameraImages>& cameras) {
  if (session.all_frames || session.scene) return std::nullopt;
  bool recorded = true, any = false;
  for (size_t c = 0; c < cameras.size(); ++c) {
    // Raw images of plenoptic cameras take a minute each: nobody has thousands.
    if (session.cameras[c].model->plenoptic) return std::nullopt;
    for (const FrameImage& image : cameras[c].images) {
      any = true;
      recorded = recorded && image.store && image.time;
    }
  }
  const size_t count = CountFrames(cameras);
  if (session.frames) return count > *session.frames ? session.frames : std::nullopt;
  if (!any || !recorded || count <= kFewFrames) return std::nullopt;
  return kUsualFrames;
}

/// Median distance of the points that two images share; not known without any.
double Displacement(const ImageSketch& a, const ImageSketch& b) {
  std::map<int, Eigen::Vector2d> places;
  for (const Observation& point : a.points) {
    places[point.marker] = {point.values[0], point.values[1]};
  }
  std::vector<double> distances;
  for (const Observation& point : b.points) {
    const auto place = places.find(point.marker);
    if (place == places.end()) continue;
    distances.push_back(
        std::hypot(point.values[0] - place->second.x(), point.values[1] - place->second.y()));
  }
  return Median(std::move(distances), kUnknown);
}

double LargerKnown(double a, double b) {
  return std::isnan(a) ? b : std::isnan(b) ? a : std::max(a, b);
}

class FrameChooser {
 public:
  FrameChooser(const Session& session, const Target& target, DetectionCache* cache, const Run& run)
      : session_(session), target_(target), cache_(cache), run_(run) {}

  FrameChoice Choose(size_t wanted, std::vector<CameraImages>* cameras) {
    run_.Message(fmt::format(
        "{} frames: at most {} of them are chosen (--all keeps all, --frames another number)",
        CountFrames(*cameras),
        wanted));
    Sketch(*cameras);
    ListInstants(*cameras);
    const std::vector<size_t> rested = AtRest(wanted);
    ChooseAmong(wanted, rested);
    return Result(cameras);
  }

 private:
  void Sketch(const std::vector<CameraImages>& cameras) {
    for (size_t c = 0; c < cameras.size(); ++c) {
      const SessionCamera& camera = session_.cameras[c];
      const std::vector<FrameImage>& images = cameras[c].images;
      if (images.empty()) {
        sketches_.emplace_back();
        continue;
      }
      sketches_.push_back(SketchImages(
          images,
          target_,
          {.white_images = cameras[c].white,
           .bayer = camera.bayer,
           .threads = run_.threads,
           .cache = cache_,
           .progress = [&](size_t done) {
             return run_.Progress(camera.name + ": look for the target", done, images.size());
           }}));
    }
  }

  void ListInstants(const std::vector<CameraImages>& cameras) {
    std::map<std::string, size_t> index;
    for (size_t c = 0; c < cameras.size(); ++c) {
      Exclusion exclusion(session_.exclude);
      std::vector<FrameImage> kept = cameras[c].images;
      std::vector<LeftOut> excluded;
      exclusion.RemoveImages(session_.cameras[c].name, &kept, &excluded);
      std::set<std::string> names;
      for (const FrameImage& image : kept) names.insert(image.frame);
      for (size_t i = 0; i < cameras[c].images.size(); ++i) {
        const std::string& name = cameras[c].images[i].frame;
        if (!names.contains(name)) continue;  // stays, to be reported as excluded
        const auto [place, is_new] = index.emplace(name, instants_.size());
        if (is_new) {
          instants_.push_back({.name = name, .image = {}, .reason = {}});
          instants_.back().image.resize(cameras.size());
        }
        AddImage(c, i, &instants_[place->second]);
      }
    }
    std::ranges::stable_sort(instants_, {}, [](const Instant& each) { return each.name; });
  }

  void AddImage(size_t c, size_t i, Instant* instant) {
    const std::vector<ImageSketch>& all = sketches_[c];
    instant->image[c] = i;
    if (all[i].points.empty()) return;
    double motion = kUnknown;
    if (i > 0) motion = Displacement(all[i - 1], all[i]);
    if (i + 1 < all.size()) motion = LargerKnown(motion, Displacement(all[i], all[i + 1]));
    instant->motion = LargerKnown(instant->motion, motion);
    instant->blur = LargerKnown(instant->blur, all[i].blur);
    instant->points += all[i].points.size();
  }

  [[nodiscard]] std::string WhyNone(const Instant& instant) const {
    for (size_t c = 0; c < sketches_.size(); ++c) {
      if (!instant.image[c]) continue;
      const std::string& why = sketches_[c][*instant.image[c]].why;
      return why.empty() ? "shows too few points of the target" : why;
    }
    return "has no image";
  }

  /// Of the instants with the target, one of each few that follow each other: the one with least
  /// motion and blur, both in terms of their medians.
  std::vector<size_t> AtRest(size_t wanted) {
    std::vector<size_t> shown;
    std::vector<double> motions, blurs;
    for (size_t i = 0; i < instants_.size(); ++i) {
      Instant& instant = instants_[i];
      if (instant.points < kFewestPoints) {
        instant.reason = WhyNone(instant);
        continue;
      }
      shown.push_back(i);
      if (!std::isnan(instant.motion)) motions.push_back(instant.motion);
      if (instant.blur > 0) blurs.push_back(instant.blur);
    }
    const double usual_motion = std::max(Median(motions, 1.0), 1e-9);
    const double usual_blur = std::max(Median(blurs, 1.0), 1e-9);
    const auto unrest = [&](size_t i) {
      const Instant& instant = instants_[i];
      const double motion = std::isnan(instant.motion) ? usual_motion : instant.motion;
      return motion / usual_motion + instant.blur / usual_blur;
    };
    const size_t window = std::max<size_t>(1, shown.size() / (kCandidates * wanted));
    std::vector<size_t> kept;
    for (size_t begin = 0; begin < shown.size(); begin += window) {
      const auto first = shown.begin() + static_cast<std::ptrdiff_t>(begin);
      const auto last =
          shown.begin() + static_cast<std::ptrdiff_t>(std::min(begin + window, shown.size()));
      const size_t best = *std::ranges::min_element(first, last, {}, unrest);
      kept.push_back(best);
      for (auto at = first; at != last; ++at) {
        if (*at == best) continue;
        instants_[*at].reason = fmt::format("moves more or is less sharp than frame {} beside it",
                                            instants_[best].name);
      }
    }
    return kept;
  }

  [[nodiscard]] View ViewOf(size_t instant, size_t c) const {
    const std::optional<size_t> image = instants_[instant].image[c];
    if (!image) return {.frame = instants_[instant].name, .observations = {}};
    return {.frame = instants_[instant].name, .observations = sketches_[c][*image].points};
  }

  /// Appearance of the target, in numbers of similar size: centre, size and shape of its points in
  /// each camera.
  [[nodiscard]] Eigen::VectorXd Appearance(size_t instant) const {
    constexpr Eigen::Index kEach = 5;
    Eigen::VectorXd appearance =
        Eigen::VectorXd::Zero(kEach * static_cast<Eigen::Index>(sketches_.size()));
    for (size_t c = 0; c < sketches_.size(); ++c) {
      const std::optional<size_t> image = instants_[instant].image[c];
      if (!image || sketches_[c][*image].points.size() < kFewestPoints) continue;
      const ImageSketch& sketch = sketches_[c][*image];
      Eigen::Matrix2Xd points(2, static_cast<Eigen::Index>(sketch.points.size()));
      for (Eigen::Index p = 0; p < points.cols(); ++p) {
        const auto& values = sketch.points[static_cast<size_t>(p)].values;
        points.col(p) = Eigen::Vector2d(values[0], values[1]) / sketch.size[0];
      }
      const Eigen::Vector2d centre = points.rowwise().mean();
      points.colwise() -= centre;
      const Eigen::Matrix2d spread =
          points * points.transpose() / static_cast<double>(points.cols());
      const double x = std::sqrt(spread(0, 0)), y = std::sqrt(spread(1, 1));
      appearance.segment<kEach>(kEach * static_cast<Eigen::Index>(c)) << centre,
          std::log(x * y + 1e-12) / 4, std::log((x + 1e-9) / (y + 1e-9)) / 2,
          spread(0, 1) / (x * y + 1e-12) / 2;
    }
    return appearance;
  }

  /// At most `most` of the instants, each next one the most different from those before.
  [[nodiscard]] std::vector<size_t> MostDifferent(const std::vector<size_t>& instants,
                                                  size_t most) const {
    std::vector<Eigen::VectorXd> appearance;
    for (const size_t i : instants) appearance.push_back(Appearance(i));
    std::vector<double> distance(instants.size(), std::numeric_limits<double>::infinity());
    std::vector<size_t> chosen;
    size_t next = 0;  // the one with most points
    for (size_t i = 1; i < instants.size(); ++i) {
      if (instants_[instants[i]].points > instants_[instants[next]].points) next = i;
    }
    while (chosen.size() < std::min(most, instants.size())) {
      chosen.push_back(instants[next]);
      distance[next] = -1;
      for (size_t i = 0; i < instants.size(); ++i) {
        if (distance[i] >= 0)
          distance[i] = std::min(distance[i], (appearance[i] - appearance[next]).norm());
      }
      next = static_cast<size_t>(std::ranges::max_element(distance) - distance.begin());
    }
    return chosen;
  }

  /// Estimate of the rig by a calibration from a few instants.
  [[nodiscard]] RigEstimate FirstEstimate(const std::vector<size_t>& instants) {
    run_.Progress("first calibration");
    std::vector<CameraInput> inputs;
    for (size_t c = 0; c < session_.cameras.size(); ++c) {
      CameraInput input = InputWithoutViews(session_.cameras[c]);
      for (const size_t i : instants) {
        View view = ViewOf(i, c);
        if (view.observations.size() < kFewestPoints) continue;
        input.image_size = sketches_[c][*instants_[i].image[c]].size;
        input.views.push_back(std::move(view));
      }
      inputs.push_back(std::move(input));
    }
    const Run silent = run_.Silent();
    const Calibration calibration =
        Calibrate(MakeCalibrationInput(session_, target_, std::move(inputs), silent),
                  {.threads = run_.threads,
                   .progress = [&](const std::string& stage) { return silent.Progress(stage); }});
    return MakeRigEstimate(Describe(calibration));
  }

  /// The target's pose by the first camera that shows enough of it.
  [[nodiscard]] std::optional<RigidTransform> PoseOf(const RigEstimate& rig, size_t instant) const {
    for (size_t c = 0; c < sketches_.size(); ++c) {
      const View view = ViewOf(instant, c);
      if (view.observations.size() < kFewestPoints) continue;
      const BundleCamera& camera = rig.bundle.cameras[c];
      const auto T_camera_target = GuessPose(camera, view, target_.markers);
      if (T_camera_target) return camera.T_camera_rig.Inverse() * *T_camera_target;
    }
    return std::nullopt;
  }

  void ChooseAmong(size_t wanted, const std::vector<size_t>& rested) {
    std::set<size_t> chosen;
    std::string why = "adds little to the frames that are chosen";
    try {
      const RigEstimate rig = FirstEstimate(MostDifferent(rested, kFirstFrames));
      run_.Progress("information of the frames");
      std::vector<std::optional<RigidTransform>> poses(rested.size());
      ParallelFor(
          rested.size(), run_.threads, [&](size_t i) { poses[i] = PoseOf(rig, rested[i]); });
      std::vector<size_t> posed;
      std::vector<RigidTransform> T_rig_target;
      for (size_t i = 0; i < rested.size(); ++i) {
        if (!poses[i]) continue;
        posed.push_back(rested[i]);
        T_rig_target.push_back(*poses[i]);
      }
      const FrameSelection gain =
          SelectFrames(rig, MakeViewTarget(target_), T_rig_target, wanted, run_.threads);
      for (const size_t i : gain.chosen) chosen.insert(posed[i]);
      if (!gain.sigma.empty()) {
        why = fmt::format(
            "adds little: the frames chosen are expected to give a standard error of the projection of {:.2g} px, all {} candidates {:.2g} px",
            gain.sigma.back(),
            posed.size(),
            gain.sigma_of_all);
      }
    } catch (const Error& error) {
      run_.Message(fmt::format("frames are chosen by coverage alone: {}", error.what()));
    }
    if (chosen.size() < std::min(kFirstFrames, wanted)) {
      for (const size_t i : MostDifferent(rested, wanted)) chosen.insert(i);
      why = "looks like frames that are chosen";
    }
    for (const size_t i : rested) {
      if (!chosen.contains(i)) instants_[i].reason = why;
    }
  }

  FrameChoice Result(std::vector<CameraImages>* cameras) const {
    FrameChoice choice;
    choice.table = "frame,chosen,motion,blur,points,reason\n";
    std::map<std::string, const Instant*> by_name;
    size_t kept = 0;
    for (const Instant& instant : instants_) {
      by_name[instant.name] = &instant;
      kept += instant.reason.empty() ? 1 : 0;
      const auto number = [](double value) {
        return std::isnan(value) ? std::string() : fmt::format("{:.3g}", value);
      };
      choice.table += fmt::format("{},{},{},{},{},{}\n",
                                  CsvCell(instant.name),
                                  instant.reason.empty() ? 1 : 0,
                                  number(instant.motion),
                                  number(instant.blur),
                                  instant.points,
                                  CsvCell(instant.reason));
    }
    for (size_t c = 0; c < cameras->size(); ++c) {
      std::erase_if((*cameras)[c].images, [&](const FrameImage& image) {
        const auto instant = by_name.find(image.frame);
        if (instant == by_name.end() || instant->second->reason.empty()) return false;
        choice.left_out.push_back({.where = image.path.string(),
                                   .reason = instant->second->reason,
                                   .whole = true,
                                   .camera = session_.cameras[c].name,
                                   .frame = image.frame});
        return true;
      });
    }
    run_.Message(
        fmt::format("{} of {} frames are chosen (reasons for the others: chosen_frames.csv)",
                    kept,
                    instants_.size()));
    return choice;
  }

  const Session& session_;
  const Target& target_;
  DetectionCache* cache_;
  const Run& run_;
  std::vector<std::vector<ImageSketch>> sketches_;  // per camera and image
  std::vector<Instant> instants_;
};

}  // namespace

FrameChoice ChooseFrames(const Session& session,
                         const Target& target,
                         DetectionCache* cache,
                         const Run& run,
                         std::vector<CameraImages>* cameras) {
  const std::optional<size_t> wanted = WantedFrames(session, *cameras);
  if (!wanted) return {};
  return FrameChooser(session, target, cache, run).Choose(*wanted, cameras);
}

}  // namespace plenocal
