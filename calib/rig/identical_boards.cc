// SPDX-License-Identifier: Apache-2.0
#include "calib/rig/identical_boards.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "calib/base/format_error.h"
#include "calib/base/statistics.h"
#include "calib/camera/marker_id.h"
#include "calib/rig/link_targets.h"
#include "calib/rig/rig_graph.h"

namespace plenocal {
namespace {

// An order is clear if it is off by less than this part of what the other one is off: pose errors
// of the initial guess would have to be larger than the boards' distance to exchange them.
constexpr double kClear = 1.0 / 3;
// Orders of images that are tried as the right one.
constexpr size_t kMostTried = 50;

enum Side : size_t { kFirst, kSecond };

// One image, its targets named as detection has them.
struct Image {
  size_t camera = 0;
  std::array<std::optional<RigidTransform>, 2> T_camera_target;
  std::optional<bool> exchanged;  // not set: undecided
  [[nodiscard]] bool ShowsBoth() const {
    return T_camera_target[kFirst] && T_camera_target[kSecond];
  }
};

// The order of an image's targets.
enum class Order { kAsDetected, kExchanged };

class PrintSorter {
 public:
  PrintSorter(const IdenticalBoards& prints,
              const std::map<int, Eigen::Vector3d>& markers,
              std::vector<CameraInput>* cameras)
      : prints_(prints), markers_(markers), cameras_(*cameras) {
    for (const auto& [number, p] : markers) {
      if (const auto side = SideOf(number)) points_[*side].push_back(p);
    }
    scale_ = Extent(kSecond) / Extent(kFirst);
  }

  std::vector<LeftOut> Run() {
    CollectImages();
    FindMutualPose();
    for (auto& [key, image] : images_) Decide(&image);
    if (!sizes_decide_ && !prints_.T_first_second) OrderFromTheLeft();
    DecideByOtherCameras();
    return Apply();
  }

 private:
  using Key = std::pair<size_t, std::string>;  // camera, frame

  [[nodiscard]] std::optional<Side> SideOf(int marker) const {
    const size_t target = MarkerId::FromNumber(marker).target;
    if (target == prints_.first) return kFirst;
    if (target == prints_.second) return kSecond;
    return std::nullopt;
  }

  // RMS distance of a target's markers from their middle.
  [[nodiscard]] double Extent(Side side) const {
    const auto count = static_cast<double>(points_[side].size());
    Eigen::Vector3d middle = Eigen::Vector3d::Zero();
    for (const Eigen::Vector3d& p : points_[side]) middle += p / count;
    double square = 0;
    for (const Eigen::Vector3d& p : points_[side]) square += (p - middle).squaredNorm() / count;
    return std::sqrt(square);
  }

  // RMS distance of the target's markers under both transforms.
  [[nodiscard]] double Distance(Side side, const RigidTransform& a, const RigidTransform& b) const {
    double square = 0;
    for (const Eigen::Vector3d& p : points_[side]) square += (a * p - b * p).squaredNorm();
    return std::sqrt(square / static_cast<double>(points_[side].size()));
  }

  void CollectImages() {
    std::vector<CameraInput> split = SplitViews({.cameras = cameras_, .markers = markers_});
    for (size_t c = 0; c < split.size(); ++c) {
      // Each camera is estimated alone.
      for (ParamRule& rule : split[c].rules) rule.tied_to.reset();
      const CameraGuess guess = Guess(split[c]);
      for (size_t v = 0; v < split[c].views.size(); ++v) {
        const View& view = split[c].views[v];
        const auto side = SideOf(view.observations[0].marker);
        if (!side) continue;
        Image& image = images_[{c, view.frame}];
        image.camera = c;
        image.T_camera_target[*side] = guess.T_camera_target[v];
      }
    }
  }

  [[nodiscard]] CameraGuess Guess(const CameraInput& camera) const {
    try {
      return GuessCamera(camera, markers_);
    } catch (const Error& error) {
      throw Error(error.kind(), fmt::format("{}: {}", camera.name, error.what()));
    }
  }

  // T_camera_target of a target in this order; REQUIRES that the image shows it in this order. A
  // board that is taken for a larger one is farther away.
  [[nodiscard]] std::optional<RigidTransform> PoseOf(const Image& image,
                                                     Side side,
                                                     Order order) const {
    if (order == Order::kAsDetected) return image.T_camera_target[side];
    std::optional<RigidTransform> T = image.T_camera_target[1 - side];
    if (T) T->t *= side == kSecond ? scale_ : 1 / scale_;
    return T;
  }

  [[nodiscard]] RigidTransform MutualPose(const Image& image, Order order) const {
    return PoseOf(image, kFirst, order)->Inverse() * *PoseOf(image, kSecond, order);
  }

  // Distance of the image's mutual pose from `T_first_second`, in both orders.
  [[nodiscard]] std::pair<double, double> Off(const Image& image,
                                              const RigidTransform& T_first_second) const {
    return {Distance(kSecond, MutualPose(image, Order::kAsDetected), T_first_second),
            Distance(kSecond, MutualPose(image, Order::kExchanged), T_first_second)};
  }

  void FindMutualPose() {
    std::vector<const Image*> both;
    for (const auto& [key, image] : images_) {
      if (image.ShowsBoth()) both.push_back(&image);
    }
    if (both.empty()) {
      throw JobError(
          "targets {} and {} have the same tags in the same arrangement, and no "
          "image shows both, so that nothing tells them apart: record images "
          "that show both, or print one with other ids (aprilgrid: 'first_id')",
          prints_.first_name,
          prints_.second_name);
    }
    if (prints_.T_first_second) {
      T_first_second_ = *prints_.T_first_second;
      return;
    }
    // Median over all images, each in the better order.
    const auto off = [&](const RigidTransform& T_first_second) {
      std::vector<double> smaller;
      for (const Image* image : both) {
        const auto [detected, exchanged] = Off(*image, T_first_second);
        smaller.push_back(std::min(detected, exchanged));
      }
      return Median(smaller);
    };
    const size_t step = (both.size() + kMostTried - 1) / kMostTried;
    double least = std::numeric_limits<double>::infinity(), other = least;
    for (size_t i = 0; i < both.size(); i += step) {
      const RigidTransform detected = MutualPose(*both[i], Order::kAsDetected),
                           exchanged = MutualPose(*both[i], Order::kExchanged);
      const double one = off(detected), two = off(exchanged);
      if (std::min(one, two) >= least) continue;
      least = std::min(one, two);
      other = std::max(one, two);
      T_first_second_ = one <= two ? detected : exchanged;
    }
    sizes_decide_ = least < kClear * other;
  }

  void Decide(Image* image) const {
    if (!image->ShowsBoth()) return;
    const auto [detected, exchanged] = Off(*image, T_first_second_);
    const double orders_apart = Distance(kSecond, T_first_second_, T_first_second_.Inverse());
    if (std::min(detected, exchanged) < kClear * std::max(detected, exchanged) &&
        std::min(detected, exchanged) < kClear * orders_apart) {
      image->exchanged = exchanged < detected;
    }
  }

  // Mean column of a target's points as detected.
  [[nodiscard]] double Column(const Key& key, Side side) const {
    double sum = 0, count = 0;
    for (const View& view : cameras_[key.first].views) {
      if (view.frame != key.second) continue;
      for (const Observation& seen : view.observations) {
        if (SideOf(seen.marker) != side) continue;
        sum += seen.values[0];
        ++count;
      }
    }
    return sum / count;
  }

  void OrderFromTheLeft() {
    const auto first = std::ranges::find_if(
        images_, [](const auto& entry) { return entry.second.exchanged.has_value(); });
    if (first == images_.end()) return;
    const bool first_is_left = Column(first->first, kFirst) < Column(first->first, kSecond);
    if (first_is_left != *first->second.exchanged) return;
    for (auto& [key, image] : images_) {
      if (image.exchanged) image.exchanged = !*image.exchanged;
    }
    T_first_second_ = T_first_second_.Inverse();
  }

  static Order OrderOf(const Image& image) {
    return *image.exchanged ? Order::kExchanged : Order::kAsDetected;
  }

  void DecideByOtherCameras() {
    std::map<Key, bool> decided;
    for (const auto& [key, image] : images_) {
      if (image.exchanged) continue;
      for (size_t c = 0; c < cameras_.size(); ++c) {
        const auto other = images_.find({c, key.second});
        if (other == images_.end() || !other->second.exchanged) continue;
        const auto T_camera_other = Extrinsics(image.camera, c);
        if (!T_camera_other) continue;
        const RigidTransform T_camera_first =
            *T_camera_other * *PoseOf(other->second, kFirst, OrderOf(other->second));
        if (const auto exchanged = OrderBy(image, T_camera_first)) decided[key] = *exchanged;
      }
    }
    for (const auto& [key, exchanged] : decided) images_[key].exchanged = exchanged;
  }

  // From frames in which both cameras' images are decided.
  [[nodiscard]] std::optional<RigidTransform> Extrinsics(size_t camera, size_t other) const {
    std::vector<RigidTransform> T_camera_other;
    for (const auto& [key, image] : images_) {
      const auto seen = images_.find({other, key.second});
      if (key.first != camera || seen == images_.end()) continue;
      if (!image.exchanged || !seen->second.exchanged) continue;
      T_camera_other.push_back(*PoseOf(image, kFirst, OrderOf(image)) *
                               PoseOf(seen->second, kFirst, OrderOf(seen->second))->Inverse());
    }
    if (T_camera_other.empty()) return std::nullopt;
    return Medoid(T_camera_other);
  }

  // True when the image's targets are exchanged, by the pose of the first one.
  [[nodiscard]] std::optional<bool> OrderBy(const Image& image,
                                            const RigidTransform& T_camera_first) const {
    const std::array<RigidTransform, 2> expected{T_camera_first, T_camera_first * T_first_second_};
    double detected = 0, exchanged = 0;
    for (const Side side : {kFirst, kSecond}) {
      if (const auto T = PoseOf(image, side, Order::kAsDetected)) {
        detected = std::max(detected, Distance(side, *T, expected[side]));
      }
      if (const auto T = PoseOf(image, side, Order::kExchanged)) {
        exchanged = std::max(exchanged, Distance(side, *T, expected[side]));
      }
    }
    if (std::min(detected, exchanged) >= kClear * std::max(detected, exchanged)) return {};
    return exchanged < detected;
  }

  std::vector<LeftOut> Apply() {
    std::vector<LeftOut> left_out;
    for (size_t c = 0; c < cameras_.size(); ++c) {
      for (View& view : cameras_[c].views) {
        const auto image = images_.find({c, view.frame});
        if (image == images_.end()) continue;
        if (image->second.exchanged) {
          if (*image->second.exchanged) Exchange(&view);
          continue;
        }
        std::erase_if(view.observations,
                      [&](const Observation& seen) { return SideOf(seen.marker).has_value(); });
        left_out.push_back(
            {.where = fmt::format("{} {}", cameras_[c].name, view.frame),
             .reason = fmt::format(
                 "targets {} and {} have the same tags in the same arrangement, and nothing tells "
                 "which of them this image shows: record it with both in view",
                 prints_.first_name,
                 prints_.second_name),
             .whole = view.observations.empty(),
             .camera = cameras_[c].name,
             .frame = view.frame});
      }
      const bool has_views = !cameras_[c].views.empty();
      std::erase_if(cameras_[c].views, [](const View& view) { return view.observations.empty(); });
      if (has_views && cameras_[c].views.empty()) {
        throw JobError(
            "{}: no image tells which of the targets {} and {} it shows; they have "
            "the same tags in the same arrangement: record frames that show both, "
            "or print one with other ids (aprilgrid: 'first_id')",
            cameras_[c].name,
            prints_.first_name,
            prints_.second_name);
      }
    }
    return left_out;
  }

  void Exchange(View* view) const {
    for (Observation& seen : view->observations) {
      const auto side = SideOf(seen.marker);
      if (!side) continue;
      const size_t other = *side == kFirst ? prints_.second : prints_.first;
      seen.marker = MarkerId{other, MarkerId::FromNumber(seen.marker).id}.Number();
    }
    std::ranges::stable_sort(view->observations, {}, &Observation::marker);
  }

  const IdenticalBoards& prints_;
  const std::map<int, Eigen::Vector3d>& markers_;
  std::vector<CameraInput>& cameras_;
  std::array<std::vector<Eigen::Vector3d>, 2> points_;  // of each target
  double scale_ = 1;                                    // size of the second / size of the first
  std::map<Key, Image> images_;
  RigidTransform T_first_second_;
  bool sizes_decide_ = false;
};

}  // namespace

std::vector<LeftOut> TellApart(const IdenticalBoards& prints,
                               const std::map<int, Eigen::Vector3d>& markers,
                               std::vector<CameraInput>* cameras) {
  return PrintSorter(prints, markers, cameras).Run();
}

}  // namespace plenocal
