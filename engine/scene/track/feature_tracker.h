// SPDX-License-Identifier: Apache-2.0
//
// Scene points followed through the images of a calibrated rig of ordinary cameras: found by SIFT
// in the first camera, in the others along the epipolar curve, followed by optical flow, and
// measured against the image in which they were found, so that their errors do not add up along the
// track.
#pragma once

#include <map>
#include <memory>
#include <opencv2/core.hpp>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calib/adjust/bundle.h"
#include "calib/camera/observation.h"
#include "engine/scene/track/track_patch.h"

namespace plenocal {

struct FeatureOptions {
  int wanted = 1000;  ///< points followed at a time
  /// Parameters and extrinsics are known: a point of the first camera lies on the epipolar curve in
  /// the others. Else it is recognised there by its descriptor.
  bool calibrated = true;
  int threads = 0;  ///< 0: all cores; the result does not depend on it
};

/// SIFT features of an image, spread over it, with root descriptors (one row each).
struct ImageFeatures {
  std::vector<cv::Point2f> points;
  cv::Mat descriptors;
};

/// Features of an 8-bit grey image: the strongest of each cell of a grid of `wanted` cells, a few
/// more where rows and columns are rounded up. Those nearer than `apart` px to a point of `taken`
/// are left out.
ImageFeatures FindFeatures(const cv::Mat& image,
                           int wanted,
                           std::span<const cv::Point2f> taken,
                           double apart);

/// Rows of `a` and `b` that are each other's best and clearly better than the second best (0.8).
std::vector<std::pair<int, int>> MatchDescriptors(const cv::Mat& a, const cv::Mat& b);

/// Which pairs of positions in two images, px, agree on one epipolar geometry (RANSAC): none when
/// they are too few to show one.
std::vector<bool> OnOneEpipolarGeometry(const std::vector<cv::Point2f>& a,
                                        const std::vector<cv::Point2f>& b);

class FeatureTracker {
 public:
  /// `first_number`: of the first track. `cameras` must outlive this.
  FeatureTracker(const std::vector<BundleCamera>& cameras,
                 const FeatureOptions& options,
                 int first_number);

  /// The next frame: one 8-bit grey image a camera, empty where there is none.
  void AddFrame(const std::string& name, const std::vector<cv::Mat>& images);

  /// A point that the first camera shows in the last frame.
  struct Followed {
    int number = 0;
    const cv::Mat* key_image = nullptr;  ///< in which it was found; valid until the next frame
    cv::Point2f in_key;
    PatchPlace now;
  };
  [[nodiscard]] std::vector<Followed> FollowedNow() const;
  /// Per camera, all frames so far; tracks that one image alone shows are left out.
  [[nodiscard]] std::vector<std::vector<View>> Views() const;
  /// Descriptors of the tracks, by number less that of the first.
  [[nodiscard]] const cv::Mat& Descriptors() const { return descriptors_; }

 private:
  struct Track {
    int number = 0;
    std::shared_ptr<const cv::Mat> key;  // the image in which it was found
    cv::Point2f in_key;
    std::vector<std::optional<PatchPlace>> now;  // per camera, in the last frame
  };

  using Pyramid = std::vector<cv::Mat>;

  std::vector<size_t> Follow(size_t camera, const Pyramid& pyramid);
  void MeasureAgainstKeys(size_t camera, const cv::Mat& image, const std::vector<size_t>& found);
  void FindAgain(const cv::Mat& image);
  void DropLost();
  void FindNew(const cv::Mat& image);
  void FindInOthers(size_t first_track, const std::vector<cv::Mat>& images);
  // About where a camera shows the tracks from `first_track` on that have no place in it, by index
  // of the track.
  std::map<size_t, cv::Point2f> GuessAlongCurves(size_t camera,
                                                 size_t first_track,
                                                 const std::vector<cv::Mat>& images) const;
  std::map<size_t, cv::Point2f> GuessByDescriptors(size_t camera,
                                                   size_t first_track,
                                                   const cv::Mat& image) const;

  const std::vector<BundleCamera>& cameras_;
  FeatureOptions options_;
  int first_number_, next_number_;
  std::vector<Track> tracks_;
  std::vector<Pyramid> last_;             // per camera
  std::vector<std::vector<View>> views_;  // sigmas against the key images; 0 in these themselves
  cv::Mat descriptors_;
};

}  // namespace plenocal
