// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/tag_detector.h"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <map>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <utility>

#include "calib/base/error.h"
#include "detectors/apriltag/apriltag_library.h"
#include "detectors/tag_assignment/assign_tags.h"
#include "detectors/tag_assignment/tag_prediction.h"
#include "detectors/tags/corner_squares.h"
#include "detectors/tags/refine_tags.h"
#include "detectors/tags/tag_template.h"
#include "targets/tags/tag_family.h"

namespace plenocal {
namespace {

using internal::CentreOf;
using internal::Convex;
using internal::MakeTagFamily;
using internal::Neighbours;
using internal::Predict;
using internal::Prediction;
using internal::Quad;
using internal::QuadPoints;
using internal::Side;
using internal::TagFamily;
using internal::TagPositions;

/// A tag as the library reads it.
struct DecodedTag {
  int id = 0;
  bool on_target = false;
  int hamming = 0;
  double margin = 0;
  double expected_by_chance = 0;  ///< how many such decoded random quads of the image would give
  Quad corners;                   ///< px, (0, 0) at the centre of the top-left pixel
};

bool Within(const Quad& q, const cv::Mat& gray) {
  return std::all_of(q.begin(), q.end(), [&](const Eigen::Vector2d& c) {
    return c.x() >= 0 && c.y() >= 0 && c.x() <= gray.cols - 1 && c.y() <= gray.rows - 1;
  });
}

/// The library's detector for the target's tags, read with up to two wrong bits, and for the
/// family's other tags, read without error, so that the user can be told about them.
class TagReader {
 public:
  TagReader(const TagFamily& family, const std::vector<int>& ids) : ids_(ids) {
    for (int id = 0; id < family.size(); ++id) {
      if (!std::binary_search(ids.begin(), ids.end(), id)) others_.push_back(id);
    }
    family_ = family.Subset(ids_, &codes_);
    other_family_ = family.Subset(others_, &other_codes_);
    if (!ids_.empty()) library_.Add(&family_, kMostWrongBits);
    if (!others_.empty()) library_.Add(&other_family_, 0);
    // A random pattern reads as a tag of the target, turned any way, when it is within `hamming`
    // bits.
    const double patterns = std::ldexp(1.0, family.data_bits());
    double near = 0, choices = 1;
    for (int wrong = 0; wrong <= kMostWrongBits; ++wrong) {
      near += choices;
      choices *= static_cast<double>(family.data_bits() - wrong) / (wrong + 1);
      chance_[wrong] = 4 * static_cast<double>(ids_.size()) * near / patterns;
    }
    chance_other_ = 4 * static_cast<double>(others_.size()) / patterns;
  }

  /// Regions of this image are read next.
  void AdaptToNoise(const cv::Mat& gray) { library_.AdaptToNoise(gray); }

  /// Reads `gray(region)` with quads searched on the image reduced by `decimate`.
  std::vector<DecodedTag> Read(const cv::Mat& gray, const cv::Rect& region, int decimate) {
    std::vector<DecodedTag> decoded;
    library_.Read(gray(region), decimate, [&](const apriltag_detection_t& found) {
      DecodedTag tag;
      tag.on_target = found.family == &family_;
      tag.id = (tag.on_target ? ids_ : others_)[static_cast<std::size_t>(found.id)];
      tag.hamming = found.hamming;
      const double chance =
          tag.on_target ? chance_[static_cast<std::size_t>(found.hamming)] : chance_other_;
      tag.expected_by_chance = chance * library_.Outlines();
      tag.margin = found.decision_margin;
      for (std::size_t k = 0; k < 4; ++k) {
        // The library counts from the pixel's corner.
        tag.corners[k] = {found.p[k][0] - 0.5 + region.x, found.p[k][1] - 0.5 + region.y};
      }
      decoded.push_back(tag);
    });
    return decoded;
  }

 private:
  std::vector<int> ids_, others_;
  std::vector<std::uint64_t> codes_, other_codes_;
  apriltag_family_t family_{}, other_family_{};
  internal::AprilTagLibrary library_;
  static constexpr int kMostWrongBits = 2;  // the library's own default and limit of memory
  std::array<double, kMostWrongBits + 1> chance_{};
  double chance_other_ = 0;
};

/// Tags found, by id, and what was refused.
struct Found {
  std::map<int, Quad> tags;
  std::map<int, double> margins;  ///< of those the library read
  std::set<int> twice;
  std::set<int> not_on_target;
  std::set<int> undecided;  ///< fit several targets
  std::set<int> misplaced;  ///< fit none

  void Add(const DecodedTag& tag) {
    const auto [at, is_new] = tags.emplace(tag.id, tag.corners);
    double& margin = margins[tag.id];
    const double apart = (CentreOf(at->second) - CentreOf(tag.corners)).norm();
    if (!is_new && apart > Side(at->second) / 2) twice.insert(tag.id);
    if (is_new || tag.margin > margin) {
      at->second = tag.corners;
      margin = tag.margin;
    }
  }
};

/// The numbers of all tags on the targets, ascending.
std::vector<int> AllIds(const std::vector<TagPositions>& targets) {
  std::set<int> ids;
  for (const TagPositions& target : targets) {
    for (const auto& [id, points] : target) ids.insert(id);
  }
  return {ids.begin(), ids.end()};
}

/// In the order of the session.
std::vector<TagPositions> AllTargets(const Target& target, const OtherTargets& others) {
  std::vector<TagPositions> targets;
  for (const Target& other : others.targets) targets.push_back(internal::TagsOf(other));
  const auto own = targets.begin() + static_cast<std::ptrdiff_t>(others.before_own);
  targets.insert(own, internal::TagsOf(target));
  return targets;
}

class TagDetector : public MarkerDetector {
 public:
  TagDetector(const Target& target, const TagLayout& layout, const OtherTargets& others = {})
      : layout_(layout),
        family_(MakeTagFamily(layout.family, layout.border_bits, layout.ids)),
        targets_(AllTargets(target, others)),
        own_(others.before_own),
        reader_(family_, AllIds(targets_)),
        points_(targets_[own_]) {
    for (const int id : layout.ids) bits_[id] = family_.Bits(id);
    border_.width = family_.width_at_border();
    border_.ring = family_.border_bits();
    border_.outside_sign = family_.classic() ? 1 : -1;
    border_.corner_squares = layout.black_corner_squares;
    if (points_.size() > 1) gap_ = Gap();
    if (border_.corner_squares) border_.outside = gap_;
  }

  /// Of the tags with these corners.
  [[nodiscard]] std::vector<internal::MarkerTemplate> Templates(
      const cv::Mat& gray, const std::map<int, Quad>& corners) const {
    // The surround of a tag is drawn as far as it is known and blurs into the tag.
    constexpr double kFarthest = 4;  // bits
    std::vector<internal::SeenTag> seen;
    for (const auto& [id, quad] : corners) seen.push_back({quad, bits_.at(id)});
    const internal::TagBorder border = BorderIn(gray, seen);
    const int margin = 1 + static_cast<int>(std::clamp(border.outside, 1.0, kFarthest));
    std::vector<internal::MarkerTemplate> templates;
    for (const auto& [id, quad] : corners) {
      const Eigen::Matrix3d cells_by_image = internal::CellsByUnitSquare(border, margin) *
                                             internal::UnitSquareHomography(quad).inverse();
      for (int k = 0; k < 4; ++k) {
        templates.push_back({.marker = 4 * id + k,
                             .position = quad[k],
                             .cells_by_image = cells_by_image,
                             .pattern = internal::DrawTag(bits_.at(id), border, margin),
                             .margin = margin,
                             .part = id});
      }
    }
    return templates;
  }

  MarkerDetections Detect(const cv::Mat& gray) override {
    // One pixel a bit is the least that can be read.
    if (std::min(gray.cols, gray.rows) < family_.width_at_border()) {
      MarkerDetections none;
      none.failure =
          fmt::format("the image is too small for a tag ({} x {} pixels)", gray.cols, gray.rows);
      return none;
    }
    Found found;
    const cv::Rect whole(0, 0, gray.cols, gray.rows);
    reader_.AdaptToNoise(gray);
    const std::vector<DecodedTag> decoded = reader_.Read(gray, whole, 2);
    if (targets_.size() > 1) {
      Keep(gray, OwnOf(ReadAll(gray, decoded), &found), &found);
      Search(gray, &found);
    } else {
      FindAlone(gray, decoded, &found);
    }
    if (const std::string other = OtherBorder(gray, CountExact(decoded)); !other.empty()) {
      MarkerDetections none;
      none.failure = other;
      return none;
    }
    return Measure(gray, found);
  }

 private:
  // One wrong tag in a thousand images does no harm to a robust adjustment.
  static constexpr double kSure = 1e-3;

  // Without a wrong bit, and not by chance.
  [[nodiscard]] static std::ptrdiff_t CountExact(const std::vector<DecodedTag>& decoded) {
    return std::ranges::count_if(decoded, [](const DecodedTag& r) {
      return r.on_target && r.hamming == 0 && r.expected_by_chance < kSure;
    });
  }

  /// Whether more tags can be read exactly with a border of another width than the `exact` ones
  /// with that of the target, in words; empty: not so. Where a 2-bit border is stated for tags with
  /// 1 bit, samples lie in the right inner cells, so that many are read with a wrong bit or two.
  [[nodiscard]] std::string OtherBorder(const cv::Mat& gray, std::ptrdiff_t exact) const {
    // More than half of the target is more than neighbours or chance can be.
    if (!family_.classic() || 2 * exact > std::ssize(layout_.ids)) return {};
    const int other = layout_.border_bits == 1 ? 2 : 1;
    const TagFamily other_family = MakeTagFamily(layout_.family, other, layout_.ids);
    TagReader reader(other_family, layout_.ids);
    reader.AdaptToNoise(gray);
    if (CountExact(reader.Read(gray, {0, 0, gray.cols, gray.rows}, 2)) <= exact) return {};
    return fmt::format(
        "no usable tag of family {} found; these look like {}: set border_bits: {} "
        "(target_border_bits)",
        layout_.family,
        other == 2 ? "Kalibr's 2-bit border" : "tags with a 1-bit border",
        other);
  }

  /// With black squares at the corners where the image shows them.
  [[nodiscard]] internal::TagBorder BorderIn(const cv::Mat& gray,
                                             const std::vector<internal::SeenTag>& seen) const {
    internal::TagBorder border = border_;
    if (const auto squares = internal::ShowsCornerSquares(gray, seen, border_)) {
      border.corner_squares = *squares;
      border.outside = *squares ? gap_ : internal::TagBorder().outside;
    }
    return border;
  }

  /// Width of the gap between neighbouring tags, in bits.
  [[nodiscard]] double Gap() const {
    double gap = std::numeric_limits<double>::infinity();
    const auto& [first_id, first] = *points_.begin();
    for (const auto& [id, points] : points_) {
      if (id == first_id) continue;
      for (const auto& a : first) {
        for (const auto& b : points) gap = std::min(gap, (a - b).norm());
      }
    }
    return gap / (first[1] - first[0]).norm() * family_.width_at_border();
  }

  /// Whether `a` is where it must be, judging by another tag alone.
  [[nodiscard]] bool Supported(const DecodedTag& a, const std::vector<DecodedTag>& decoded) const {
    return std::any_of(decoded.begin(), decoded.end(), [&](const DecodedTag& b) {
      if (!b.on_target || b.id == a.id) return false;
      const auto expected = Predict(points_, a.id, {{b.id, b.corners}}, Neighbours::kAll);
      if (!expected) return false;
      for (std::size_t k = 0; k < 4; ++k) {
        if ((expected->corners[k] - a.corners[k]).norm() > Side(a.corners) / 2) return false;
      }
      return true;
    });
  }

  /// Without others.
  void FindAlone(const cv::Mat& gray, const std::vector<DecodedTag>& decoded, Found* found) {
    const cv::Rect whole(0, 0, gray.cols, gray.rows);
    Keep(gray, decoded, found);
    bool incomplete = Search(gray, found);
    if (incomplete && border_.corner_squares) {
      Keep(gray, reader_.Read(Apart(gray), whole, 2), found);
      incomplete = Search(gray, found);
    }
    if (incomplete) {
      Keep(gray, reader_.Read(gray, whole, 1), found);
      Search(gray, found);
    }
  }

  /// Where black has spread, tags hang together with the squares at their corners, and the library
  /// sees no outlines.
  static cv::Mat Apart(const cv::Mat& gray) {
    cv::Mat apart;
    cv::dilate(gray, apart, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
    return apart;
  }

  /// All readings together, so that the detectors of all targets sort the same tags.
  std::vector<DecodedTag> ReadAll(const cv::Mat& gray, std::vector<DecodedTag> decoded) {
    const cv::Rect whole(0, 0, gray.cols, gray.rows);
    const auto add = [&](const std::vector<DecodedTag>& more) {
      decoded.insert(decoded.end(), more.begin(), more.end());
    };
    if (border_.corner_squares) add(reader_.Read(Apart(gray), whole, 2));
    add(reader_.Read(gray, whole, 1));
    std::vector<DecodedTag> all;
    for (const DecodedTag& tag : decoded) {
      if (!Convex(tag.corners)) continue;
      const auto same = std::ranges::find_if(all, [&](const DecodedTag& other) {
        return other.id == tag.id &&
               (CentreOf(other.corners) - CentreOf(tag.corners)).norm() < Side(tag.corners) / 2;
      });
      if (same == all.end()) {
        all.push_back(tag);
      } else if (tag.margin > same->margin) {
        *same = tag;
      }
    }
    return all;
  }

  /// Those of this detector's target, and those that are on no target.
  std::vector<DecodedTag> OwnOf(const std::vector<DecodedTag>& all, Found* found) const {
    std::vector<internal::ReadTag> read;
    for (const DecodedTag& tag : all) read.push_back({tag.id, tag.corners});
    const std::vector<internal::TagOwner> owners = internal::AssignTags(read, targets_);
    std::vector<DecodedTag> own;
    for (std::size_t i = 0; i < all.size(); ++i) {
      if (!all[i].on_target || owners[i].target == own_) {
        own.push_back(all[i]);
      } else if (!owners[i].target && all[i].expected_by_chance < kSure) {
        (owners[i].fits_several ? found->undecided : found->misplaced).insert(all[i].id);
      }
    }
    return own;
  }

  /// Adds the decoded that are not chance.
  void Keep(const cv::Mat& gray, const std::vector<DecodedTag>& decoded, Found* found) const {
    for (const DecodedTag& r : decoded) {
      if (!Convex(r.corners) || Side(r.corners) < family_.width_at_border()) continue;
      const bool sure = r.expected_by_chance < kSure;
      if (!r.on_target) {
        if (sure) found->not_on_target.insert(r.id);
      } else if (sure || Supported(r, decoded) ||
                 (r.hamming == 0 &&
                  internal::FindTag(gray, {r.corners, bits_.at(r.id)}, border_, 0))) {
        found->Add(r);
      }
    }
  }

  /// Looks for missing tags near those found, until no more turn up. True when some tag may be
  /// anywhere in the image, or more are missing that should be in the image than were found.
  bool Search(const cv::Mat& gray, Found* found) {
    bool anywhere = found->tags.empty();
    std::size_t in_view = 0;           // of the missing ones
    std::map<int, std::size_t> tried;  // with how many tags known
    for (bool more = !anywhere; more;) {
      more = anywhere = false;
      in_view = 0;
      std::vector<std::pair<double, int>> missing;
      for (const int id : layout_.ids) {
        if (found->tags.contains(id)) continue;
        if (const auto expected = Predict(points_, id, found->tags, Neighbours::kAll)) {
          missing.emplace_back(expected->distance, id);
          in_view += Within(expected->corners, gray) ? 1 : 0;
        } else {
          anywhere = true;
        }
      }
      std::sort(missing.begin(), missing.end());
      for (const auto& [distance, id] : missing) {
        if (tried[id] == found->tags.size()) continue;
        tried[id] = found->tags.size();
        if (FindByNeighbours(gray, id, found)) more = true;
      }
    }
    return anywhere || in_view > found->tags.size();
  }

  bool FindByNeighbours(const cv::Mat& gray, int id, Found* found) {
    std::size_t tried = 0;
    for (const Neighbours which : {Neighbours::kNearest, Neighbours::kAll}) {
      const auto expected = Predict(points_, id, found->tags, which);
      if (!expected || !Convex(expected->corners) || expected->neighbours == tried) continue;
      tried = expected->neighbours;
      if (FindNear(gray, id, *expected, found)) return true;
    }
    return false;
  }

  bool FindNear(const cv::Mat& gray, int id, const Prediction& expected, Found* found) {
    const double side = Side(expected.corners);
    if (side < family_.width_at_border() / 2.0) return false;
    // A neighbour's corners carry a tag's place to its own distance within a quarter of its side.
    const double reach = std::max(2.0, side / 4);
    Eigen::AlignedBox2d box;
    for (const auto& c : expected.corners) box.extend(c);
    const double room = reach + side / 2;
    const cv::Rect region = cv::Rect(cv::Point(static_cast<int>(box.min().x() - room),
                                               static_cast<int>(box.min().y() - room)),
                                     cv::Point(static_cast<int>(box.max().x() + room),
                                               static_cast<int>(box.max().y() + room))) &
                            cv::Rect(0, 0, gray.cols, gray.rows);
    Quad inner = expected.corners;
    for (auto& c : inner) c += (box.center() - c).normalized() * std::min(reach, side / 2);
    if (!Within(inner, gray)) return false;
    for (const DecodedTag& r : reader_.Read(gray, region, 1)) {
      const bool near = (CentreOf(r.corners) - CentreOf(expected.corners)).norm() < side;
      if (r.on_target && r.id == id && near) {
        found->Add(r);
        return true;
      }
    }
    // The place that resembles a small tag most may be a neighbour's; then the prediction is
    // better.
    for (const double away : {reach, 0.0}) {
      const auto quad = internal::FindTag(gray, {expected.corners, bits_.at(id)}, border_, away);
      if (quad) {
        found->tags.emplace(id, *quad);
        return true;
      }
    }
    return false;
  }

  MarkerDetections Measure(const cv::Mat& gray, const Found& found) {
    MarkerDetections result;
    std::vector<internal::SeenTag> seen;
    std::vector<int> ids;
    for (const auto& [id, corners] : found.tags) {
      if (found.twice.contains(id)) {
        result.left_out.push_back(fmt::format("tag {} appears twice in the image", id));
        continue;
      }
      ids.push_back(id);
      seen.push_back({corners, bits_.at(id)});
    }
    for (const int id : found.undecided) {
      result.left_out.push_back(internal::FitsSeveral("tag", id));
    }
    for (const int id : found.misplaced) {
      result.left_out.push_back(
          fmt::format("tag {} is where none of the targets in view can have it", id));
    }
    for (const int id : found.not_on_target) {
      result.left_out.push_back(
          fmt::format("tag {} ({}) is not on the target", id, layout_.family));
    }
    internal::RefinedTags refined = internal::RefineTags(gray, seen, BorderIn(gray, seen));
    result.measurements = std::move(refined.measurements);
    constexpr std::array kCorners{"lower left", "lower right", "upper right", "upper left"};
    for (std::size_t i = 0; i < ids.size(); ++i) {
      for (std::size_t k = 0; k < 4; ++k) {
        const auto& corner = refined.quads[i][k];
        if (!corner) {
          result.left_out.push_back(fmt::format(
              "{} corner of tag {}: the image is not like the tag there", kCorners[k], ids[i]));
          continue;
        }
        result.markers.push_back({.marker = 4 * ids[i] + static_cast<int>(k),
                                  .values = {corner->point.x(), corner->point.y()},
                                  .detector_sigma = corner->sigma});
        result.sensitivities.push_back(corner->sensitivity);
      }
    }
    if (result.markers.empty()) result.failure = Failure(found, result.left_out);
    return result;
  }

  [[nodiscard]] std::string Failure(const Found& found,
                                    const std::vector<std::string>& left_out) const {
    if (!found.not_on_target.empty() && found.tags.empty()) {
      return fmt::format("no tag of the target found; of family {} the image shows {}",
                         layout_.family,
                         fmt::join(found.not_on_target, ", "));
    }
    if (!left_out.empty()) return fmt::format("no usable tag: {}", fmt::join(left_out, "; "));
    return fmt::format("no tag of family {} found", layout_.family);
  }

  TagLayout layout_;
  TagFamily family_;
  std::vector<TagPositions> targets_;  // its own and its others
  std::size_t own_;                    // index of its own
  TagReader reader_;
  internal::TagBorder border_;
  double gap_ = internal::TagBorder().outside;  ///< between tags, bits; of one tag as usual
  std::map<int, std::vector<bool>> bits_;
  TagPositions points_;
};

}  // namespace

std::vector<internal::MarkerTemplate> internal::MakeTemplates(const TagLayout& layout,
                                                              const Target& target,
                                                              const std::vector<Observation>& found,
                                                              const cv::Mat& gray) {
  std::map<int, std::map<int, Eigen::Vector2d>> by_tag;
  for (const Observation& seen : found) {
    by_tag[seen.marker / 4][seen.marker % 4] = {seen.values[0], seen.values[1]};
  }
  std::map<int, Quad> whole;
  for (const auto& [id, corners] : by_tag) {
    if (corners.size() < 4) continue;
    whole[id] = {corners.at(0), corners.at(1), corners.at(2), corners.at(3)};
  }
  return TagDetector(target, layout).Templates(gray, whole);
}

std::unique_ptr<MarkerDetector> MakeDetector(const TagLayout& layout,
                                             const Target& target,
                                             const OtherTargets& others) {
  return std::make_unique<TagDetector>(target, layout, others);
}

}  // namespace plenocal
