// SPDX-License-Identifier: Apache-2.0
#include "detectors/tags/tag_detector.h"

#include <apriltag/apriltag.h>
#include <fmt/core.h>
#include <fmt/ranges.h>

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
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
#include "calib/base/linear_algebra.h"
#include "detectors/tags/corner_squares.h"
#include "detectors/tags/refine_tags.h"
#include "detectors/tags/tag_patterns.h"
#include "targets/tags/tag_family.h"

namespace plenocal {
namespace {

using internal::MakeTagFamily;
using internal::Quad;
using internal::TagFamily;

/// A tag as the library reads it.
struct DecodedTag {
  int id = 0;
  bool on_target = false;
  int hamming = 0;
  double margin = 0;
  double expected_by_chance = 0;  ///< how many such decoded random quads of the image would give
  Quad corners;                   ///< px, (0, 0) at the centre of the top-left pixel
};

Eigen::Vector2d Centre(const Quad& q) { return (q[0] + q[1] + q[2] + q[3]) / 4; }

/// Mean length of the sides.
double Side(const Quad& q) {
  double sum = 0;
  for (std::size_t k = 0; k < 4; ++k) sum += (q[(k + 1) % 4] - q[k]).norm();
  return sum / 4;
}

bool Convex(const Quad& q) {
  int left = 0;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector2d a = q[(k + 1) % 4] - q[k], b = q[(k + 2) % 4] - q[(k + 1) % 4];
    left += a.x() * b.y() > a.y() * b.x();
  }
  return left == 0 || left == 4;
}

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
    detector_ = apriltag_detector_create();
    detector_->nthreads = 1;
    if (!ids_.empty()) apriltag_detector_add_family_bits(detector_, &family_, kMostWrongBits);
    if (!others_.empty()) apriltag_detector_add_family_bits(detector_, &other_family_, 0);
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
  TagReader(const TagReader&) = delete;
  TagReader& operator=(const TagReader&) = delete;
  ~TagReader() { apriltag_detector_destroy(detector_); }

  /// Reads `gray(region)` with quads searched on the image reduced by `decimate`.
  std::vector<DecodedTag> Read(const cv::Mat& gray, const cv::Rect& region, float decimate) {
    detector_->quad_decimate = decimate;
    const cv::Mat part = gray(region);
    image_u8_t image{part.cols, part.rows, static_cast<std::int32_t>(part.step), part.data};
    zarray_t* detections = apriltag_detector_detect(detector_, &image);
    std::vector<DecodedTag> decoded;
    for (int i = 0; i < zarray_size(detections); ++i) {
      apriltag_detection_t* found = nullptr;
      zarray_get(detections, i, &found);
      DecodedTag tag;
      tag.on_target = found->family == &family_;
      tag.id = (tag.on_target ? ids_ : others_)[static_cast<std::size_t>(found->id)];
      tag.hamming = found->hamming;
      const double chance =
          tag.on_target ? chance_[static_cast<std::size_t>(found->hamming)] : chance_other_;
      tag.expected_by_chance = chance * detector_->nquads;
      tag.margin = found->decision_margin;
      for (std::size_t k = 0; k < 4; ++k) {
        // The library counts from the pixel's corner.
        tag.corners[k] = {found->p[k][0] - 0.5 + region.x, found->p[k][1] - 0.5 + region.y};
      }
      decoded.push_back(tag);
    }
    apriltag_detections_destroy(detections);
    return decoded;
  }

 private:
  std::vector<int> ids_, others_;
  std::vector<std::uint64_t> codes_, other_codes_;
  apriltag_family_t family_{}, other_family_{};
  apriltag_detector_t* detector_;
  static constexpr int kMostWrongBits = 2;  // the library's own default and limit of memory
  std::array<double, kMostWrongBits + 1> chance_{};
  double chance_other_ = 0;
};

using TagPoints = std::array<Eigen::Vector3d, 4>;

/// Where a tag of the target should be, judging by those found near it in its plane.
struct Prediction {
  Quad corners;
  double distance = 0;         ///< of the nearest tag found / the tag's side
  std::size_t neighbours = 0;  ///< that it rests on
};

/// Which neighbours predict a tag: up to four, or of these the ones about as near as the nearest. A
/// strong lens bends the target more than one homography describes, the more the farther the
/// neighbours; more neighbours determine the homography better.
enum class Neighbours { kAll, kNearest };

std::optional<Prediction> Predict(const std::map<int, TagPoints>& target,
                                  int id,
                                  const std::map<int, Quad>& found,
                                  Neighbours which) {
  // Few and near, so that lens distortion and a bent target matter little.
  constexpr std::size_t kNeighbours = 4;
  constexpr double kAsNear = 1.6;  // the next tags of a grid, across its corners too
  const TagPoints& tag = target.at(id);
  const Eigen::Vector3d centre = (tag[0] + tag[1] + tag[2] + tag[3]) / 4;
  const double side = (tag[1] - tag[0]).norm();
  const Eigen::Vector3d e_x = (tag[1] - tag[0]) / side;
  const Eigen::Vector3d normal = (tag[1] - tag[0]).cross(tag[3] - tag[0]).normalized();
  const Eigen::Vector3d e_y = normal.cross(e_x);
  const auto on_plane = [&](const Eigen::Vector3d& p) -> Eigen::Vector2d {
    return Eigen::Vector2d(e_x.dot(p - centre), e_y.dot(p - centre)) / side;
  };
  std::vector<std::pair<double, int>> neighbours;
  for (const auto& [other, corners] : found) {
    if (other == id) continue;
    const TagPoints& points = target.at(other);
    double off_plane = 0;
    for (const auto& p : points) off_plane = std::max(off_plane, std::abs(normal.dot(p - centre)));
    const double away = (points[0] + points[2] - 2 * centre).norm() / 2 / side;
    // A tenth of the way, so that a bent board still counts as one plane.
    if (off_plane / side < 0.25 + 0.1 * away) neighbours.emplace_back(away, other);
  }
  if (neighbours.empty()) return std::nullopt;
  std::sort(neighbours.begin(), neighbours.end());
  neighbours.resize(std::min(neighbours.size(), kNeighbours));
  if (which == Neighbours::kNearest) {
    const double limit = kAsNear * neighbours[0].first;
    std::erase_if(neighbours, [&](const auto& neighbour) { return neighbour.first > limit; });
  }

  Eigen::Vector2d middle(0, 0);
  for (const auto& [away, other] : neighbours) {
    middle += Centre(found.at(other)) / static_cast<double>(neighbours.size());
  }
  const double scale = Side(found.at(neighbours[0].second));
  Eigen::MatrixXd rows(8 * neighbours.size(), 9);
  int row = 0;
  for (const auto& [away, other] : neighbours) {
    for (std::size_t k = 0; k < 4; ++k) {
      const Eigen::RowVector3d x = on_plane(target.at(other)[k]).homogeneous().transpose();
      const Eigen::Vector2d u = (found.at(other)[k] - middle) / scale;
      rows.row(row++) << x, Eigen::RowVector3d::Zero(), -u.x() * x;
      rows.row(row++) << Eigen::RowVector3d::Zero(), x, -u.y() * x;
    }
  }
  const Eigen::MatrixXd square = rows.transpose() * rows;
  const Eigen::VectorXd h = DecomposeSymmetric(square).vectors.col(0);
  const Eigen::Matrix3d H =
      Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(h.data());
  const double front = H.row(2) * on_plane(target.at(neighbours[0].second)[0]).homogeneous();
  Prediction prediction;
  for (std::size_t k = 0; k < 4; ++k) {
    const Eigen::Vector3d at = H * on_plane(tag[k]).homogeneous();
    if (at.z() * front <= 0) return std::nullopt;
    prediction.corners[k] = at.hnormalized() * scale + middle;
  }
  prediction.distance = neighbours[0].first;
  prediction.neighbours = neighbours.size();
  return prediction;
}

/// Tags found, by id, and what was refused.
struct Found {
  std::map<int, Quad> tags;
  std::map<int, double> margins;  ///< of those the library read
  std::set<int> twice;
  std::set<int> not_on_target;

  void Add(const DecodedTag& tag) {
    const auto [at, is_new] = tags.emplace(tag.id, tag.corners);
    double& margin = margins[tag.id];
    const double apart = (Centre(at->second) - Centre(tag.corners)).norm();
    if (!is_new && apart > Side(at->second) / 2) twice.insert(tag.id);
    if (is_new || tag.margin > margin) {
      at->second = tag.corners;
      margin = tag.margin;
    }
  }
};

class TagDetector : public MarkerDetector {
 public:
  TagDetector(const Target& target, const TagLayout& layout)
      : layout_(layout),
        family_(MakeTagFamily(layout, layout.border_bits)),
        reader_(family_, layout.ids) {
    for (const int id : layout.ids) {
      bits_[id] = family_.Bits(id);
      for (int k = 0; k < 4; ++k) points_[id][k] = target.markers.at(4 * id + k);
    }
    border_.width = family_.width_at_border();
    border_.ring = family_.border_bits();
    border_.outside_sign = family_.classic() ? 1 : -1;
    border_.corner_squares = layout.black_corner_squares;
    if (points_.size() > 1) gap_ = Gap();
    if (border_.corner_squares) border_.outside = gap_;
  }

  [[nodiscard]] internal::TagPatterns Patterns(const cv::Mat& gray,
                                               const std::map<int, Quad>& found) const {
    std::vector<internal::SeenTag> seen;
    for (const auto& [id, corners] : found) seen.push_back({corners, bits_.at(id)});
    return {BorderIn(gray, seen), bits_};
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
    const std::vector<DecodedTag> decoded = reader_.Read(gray, whole, 2);
    Keep(gray, decoded, &found);
    bool incomplete = Search(gray, &found);
    if (incomplete && border_.corner_squares) {
      // Where black has spread, tags hang together with the squares at their corners, and the
      // library sees no outlines.
      cv::Mat apart;
      cv::dilate(gray, apart, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
      Keep(gray, reader_.Read(apart, whole, 2), &found);
      incomplete = Search(gray, &found);
    }
    if (incomplete) {
      Keep(gray, reader_.Read(gray, whole, 1), &found);
      Search(gray, &found);
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
    const TagFamily other_family = MakeTagFamily(layout_, other);
    TagReader reader(other_family, layout_.ids);
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
      const bool near = (Centre(r.corners) - Centre(expected.corners)).norm() < side;
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
        Observation observation;
        observation.marker = 4 * ids[i] + static_cast<int>(k);
        observation.values = {corner->point.x(), corner->point.y()};
        observation.detector_sigma = corner->sigma;
        result.markers.push_back(observation);
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
  TagReader reader_;
  internal::TagBorder border_;
  double gap_ = internal::TagBorder().outside;  ///< between tags, bits; of one tag as usual
  std::map<int, std::vector<bool>> bits_;
  std::map<int, TagPoints> points_;
};

}  // namespace

internal::TagPatterns internal::FindTagPatterns(const TagLayout& layout,
                                                const Target& target,
                                                const cv::Mat& gray,
                                                const std::map<int, Quad>& found) {
  return TagDetector(target, layout).Patterns(gray, found);
}

std::unique_ptr<MarkerDetector> MakeDetector(const TagLayout& layout, const Target& target) {
  return std::make_unique<TagDetector>(target, layout);
}

}  // namespace plenocal
