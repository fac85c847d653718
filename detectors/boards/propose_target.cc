// SPDX-License-Identifier: Apache-2.0
#include "detectors/boards/propose_target.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <numeric>
#include <opencv2/aruco.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <set>
#include <utility>

#include "calib/base/error.h"
#include "calib/base/parallel.h"
#include "detectors/apriltag/apriltag_library.h"
#include "detectors/boards/blob_grid.h"
#include "detectors/boards/corner_lattice.h"
#include "detectors/boards/marker_layout.h"
#include "detectors/images/image.h"
#include "detectors/images/opencv_threads.h"
#include "detectors/images/pictures.h"
#include "targets/code_books.h"
#include "targets/tags/tag_family.h"

namespace plenocal {
namespace {

using internal::BlobGrid;
using internal::MarkerLayout;
using internal::NumberedSquare;

/// A family of AprilTags with a border of some width, or an ArUco dictionary.
struct Code {
  std::string name;
  int border_bits = 0;                            ///< 0: ArUco
  auto operator<=>(const Code&) const = default;  // NOLINT(modernize-use-nullptr): none is here
};

/// What one image shows.
struct Seen {
  std::map<Code, std::vector<NumberedSquare>> markers;
  std::optional<std::pair<int, int>> corners;  ///< of a chessboard, the larger number first
  std::optional<BlobGrid> circles;
};

/// Reads tags of all families with borders of one and two bits, without wrong bits.
class AnyTagReader {
 public:
  AnyTagReader() {
    for (const internal::CodeBook& book : internal::kTagFamilies) {
      for (const int border : {1, 2}) {
        internal::TagFamily family(book.name, border);
        if (border > 1 && !family.classic()) continue;
        Entry& entry = *entries_.emplace_back(
            std::make_unique<Entry>(Entry{{std::string(book.name), border}, std::move(family)}));
        std::vector<int> ids(static_cast<std::size_t>(book.size));
        std::iota(ids.begin(), ids.end(), 0);
        entry.subset = entry.family.Subset(ids, &entry.codes);
        library_.Add(&entry.subset, 0);
      }
    }
  }

  void Read(const cv::Mat& gray, Seen* seen) {
    ReadOnce(gray, seen);
    if (!seen->markers.empty()) return;
    // Kalibr's grids, where tags hang together with the squares at their corners.
    cv::Mat apart;
    cv::dilate(gray, apart, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
    ReadOnce(apart, seen);
  }

 private:
  struct Entry {
    Code code;
    internal::TagFamily family;
    std::vector<std::uint64_t> codes = {};
    apriltag_family_t subset = {};
  };

  void ReadOnce(const cv::Mat& gray, Seen* seen) {
    constexpr double kLeastMargin = 15;  // grey values between black and white bits
    constexpr int kSmall = 1000;         // px
    library_.AdaptToNoise(gray);
    const int decimate = std::max(gray.cols, gray.rows) > kSmall ? 2 : 1;
    library_.Read(gray, decimate, [&](const apriltag_detection_t& found) {
      if (found.decision_margin < kLeastMargin) return;
      const auto entry = std::ranges::find_if(
          entries_, [&](const auto& each) { return &each->subset == found.family; });
      NumberedSquare square{.id = found.id, .corners = {}};
      for (std::size_t k = 0; k < 4; ++k) {
        // The library begins at the lower left and goes round the other way.
        square.corners[k] = {found.p[3 - k][0], found.p[3 - k][1]};
      }
      seen->markers[(*entry)->code].push_back(square);
    });
  }

  std::vector<std::unique_ptr<Entry>> entries_;
  internal::AprilTagLibrary library_;  // keeps pointers to the entries
};

/// The largest dictionary of each kind: the smaller ones are the beginnings of these. (AprilTags
/// are read as such.)
constexpr std::array<std::string_view, 5> kDictionaries{
    "DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL"};

void ReadAruco(const cv::Mat& gray, Seen* seen) {
  const auto parameters = cv::makePtr<cv::aruco::DetectorParameters>();
  parameters->errorCorrectionRate = 0;  // near misses of a wrong dictionary count for nothing
  for (const std::string_view name : kDictionaries) {
    const auto place =
        std::ranges::find(internal::kArucoDictionaries, name, &internal::CodeBook::name);
    const auto dictionary = cv::makePtr<cv::aruco::Dictionary>(cv::aruco::getPredefinedDictionary(
        static_cast<int>(place - internal::kArucoDictionaries.begin())));
    std::vector<std::vector<cv::Point2f>> corners;
    std::vector<int> ids;
    cv::aruco::detectMarkers(gray, dictionary, corners, ids, parameters);
    for (std::size_t i = 0; i < ids.size(); ++i) {
      NumberedSquare square{.id = ids[i], .corners = {}};
      for (std::size_t k = 0; k < 4; ++k) square.corners[k] = {corners[i][k].x, corners[i][k].y};
      seen->markers[{std::string(name), 0}].push_back(square);
    }
  }
}

void FindChessboard(const cv::Mat& gray, Seen* seen) {
  constexpr int kFewest = 9, kNarrowest = 3;
  std::size_t most = 0;
  for (const internal::CornerLattice& lattice : internal::FindCornerLattices(gray, kFewest)) {
    const auto [narrow, wide] = std::minmax(lattice.columns, lattice.rows);
    if (narrow < kNarrowest || lattice.corners.size() <= most) continue;
    most = lattice.corners.size();
    seen->corners = {wide, narrow};
  }
}

/// A marker or two may be chance: of 4 x 4 bits one quadrangle in twenty is one.
bool HasMarkers(const Seen& seen) {
  constexpr std::size_t kFewest = 4;
  return std::ranges::any_of(seen.markers,
                             [](const auto& entry) { return entry.second.size() >= kFewest; });
}

Seen Look(const FrameImage& image) {
  constexpr double kLargest = 1920;  // px: enough for what is to be recognised only
  cv::Mat gray = ReadGray(image);
  gray = Reduced(gray, kLargest / std::max(gray.cols, gray.rows));
  Seen seen;
  AnyTagReader().Read(gray, &seen);
  if (HasMarkers(seen)) return seen;
  ReadAruco(gray, &seen);
  if (!HasMarkers(seen)) {
    Seen inverted;  // printed white on black
    ReadAruco(255 - gray, &inverted);
    if (HasMarkers(inverted)) seen.markers = std::move(inverted.markers);
  }
  FindChessboard(gray, &seen);
  if (HasMarkers(seen)) return seen;
  constexpr double kLargestOfBlobs = 1000;  // px
  const double smaller = kLargestOfBlobs / std::max(gray.cols, gray.rows);
  seen.circles = internal::FindBlobGrid(Reduced(gray, smaller));
  if (seen.circles && seen.corners) {
    // Between circles brightness has saddles as at corners, and dark squares look like circles in
    // an asymmetric grid, fewer than their corners.
    const int circles = seen.circles->columns * seen.circles->rows;
    if (!seen.circles->asymmetric || circles >= seen.corners->first * seen.corners->second) {
      seen.corners.reset();
    } else {
      seen.circles.reset();
    }
  }
  return seen;
}

/// The most frequent of the values, and how often it occurs.
template <typename T>
std::pair<T, size_t> MostFrequent(const std::vector<T>& values) {
  std::map<T, size_t> counts;
  for (const T& value : values) ++counts[value];
  const auto most =
      std::ranges::max_element(counts, {}, [](const auto& entry) { return entry.second; });
  return *most;
}

std::optional<TargetProposal> ProposeChessboard(const std::vector<Seen>& images) {
  std::vector<std::pair<int, int>> sizes;
  for (const Seen& seen : images) {
    if (seen.corners) sizes.push_back(*seen.corners);
  }
  if (sizes.empty()) return std::nullopt;
  const auto [size, count] = MostFrequent(sizes);
  const auto& [columns, rows] = size;
  const std::string shows = fmt::format("{} x {} inner corners", columns, rows);
  return TargetProposal{
      .what = "chessboard with " + shows,
      .shows = shows,
      .word = fmt::format("chessboard:{}x{}:SIZE", columns, rows),
      .keys = fmt::format("type: chessboard\ncolumns: {}\nrows: {}\n", columns, rows),
      .measure = {{"square", "side of a square, such as 25 mm, or unknown"}},
      .images = count};
}

std::optional<TargetProposal> ProposeCircles(const std::vector<Seen>& images) {
  std::vector<std::tuple<int, int, bool>> grids;
  for (const Seen& seen : images) {
    if (!seen.circles) continue;
    grids.emplace_back(seen.circles->columns, seen.circles->rows, seen.circles->asymmetric);
  }
  if (grids.empty()) return std::nullopt;
  const auto [grid, count] = MostFrequent(grids);
  const auto& [columns, rows, asymmetric] = grid;
  const char* pattern = asymmetric ? "asymmetric" : "symmetric";
  return TargetProposal{
      .what = fmt::format("{} grid of {} x {} circles", pattern, columns, rows),
      .shows = fmt::format("{} x {} circles in {} pattern", columns, rows, pattern),
      .word = fmt::format("circles:{}x{}:SPACING:{}", columns, rows, pattern),
      .keys = fmt::format(
          "type: circles\ncolumns: {}\nrows: {}\npattern: {}\n", columns, rows, pattern),
      .measure = {{"spacing",
                   asymmetric ? "distance of neighbouring rows, such as 20 mm, or unknown"
                              : "distance of neighbouring circles, such as 20 mm, or unknown"}},
      .images = count};
}

TargetProposal TagGridProposal(const Code& code, const MarkerLayout& layout) {
  const std::string shows = fmt::format("{} x {} tags of {} from id {} on, {} bit{} of border",
                                        layout.columns,
                                        layout.rows,
                                        code.name,
                                        layout.first_id,
                                        code.border_bits,
                                        code.border_bits == 1 ? "" : "s");
  const std::string spacing = fmt::format("{:.2g}", layout.pitch - 1);
  std::string more;
  if (code.name != internal::kDefaultFamily.name) more += ":" + code.name;
  if (code.border_bits != 2) more += fmt::format(":border_bits={}", code.border_bits);
  if (layout.first_id != 0) more += fmt::format(":first_id={}", layout.first_id);
  return {
      .what = fmt::format("AprilGrid with {}, gaps of about {} of a tag", shows, spacing),
      .shows = shows,
      .word = fmt::format("aprilgrid:{}x{}:SIZE:SPACING{}", layout.columns, layout.rows, more),
      .keys = fmt::format("type: aprilgrid\nfamily: {}\ncolumns: {}\nrows: {}\nborder_bits: {}\n"
                          "first_id: {}\n",
                          code.name,
                          layout.columns,
                          layout.rows,
                          code.border_bits,
                          layout.first_id),
      .measure = {{"size", "side of a tag's black border, such as 88 mm, or unknown"},
                  {"spacing",
                   fmt::format("gap between tags / size, or the gap with its unit; the images "
                               "show about {}",
                               spacing)}}};
}

/// The smallest dictionary with so many markers that begins as `name` does.
std::string SmallestDictionary(std::string_view name, int markers) {
  const std::string_view kind = name.substr(0, name.rfind('_') + 1);
  for (const internal::CodeBook& book : internal::kArucoDictionaries) {
    if (book.name.starts_with(kind) && book.size >= markers) return std::string(book.name);
  }
  return std::string(name);
}

TargetProposal CharucoProposal(const Code& code, const MarkerLayout& layout) {
  const std::string dictionary =
      code.border_bits == 0 ? SmallestDictionary(code.name, layout.columns * layout.rows / 2)
                            : "DICT_APRILTAG_" + code.name.substr(std::string("tag").size());
  const std::string shows =
      fmt::format("{} x {} squares, {}", layout.columns, layout.rows, dictionary);
  return {.what = fmt::format(
              "ChArUco board with {}, markers about {:.2g} of a square", shows, 1 / layout.pitch),
          .shows = shows,
          .word = fmt::format("charuco:{}x{}:SQUARE:MARKER:{}",
                              layout.columns,
                              layout.rows,
                              dictionary.substr(std::string("DICT_").size())),
          .keys = fmt::format("type: charuco\ncolumns: {}\nrows: {}\ndictionary: {}\n",
                              layout.columns,
                              layout.rows,
                              dictionary),
          .measure = {{"square", "side of a square, such as 36 mm, or unknown"},
                      {"marker",
                       fmt::format("side of a marker with its black border, such as 18 mm; the "
                                   "images show about {:.2g} of a square",
                                   1 / layout.pitch)}}};
}

/// ArUco markers in a grid, which no target type describes.
TargetProposal ArucoGrid(const Code& code, const MarkerLayout& layout) {
  const std::string shows = fmt::format(
      "{} x {} ArUco markers of {} without a chessboard", layout.columns, layout.rows, code.name);
  return {.what = shows, .shows = shows};
}

/// Tags in no regular layout.
TargetProposal LooseTags(const Code& code, size_t ids) {
  const std::string shows = fmt::format("{} tags of {}", ids, code.name);
  return {.what = shows + " in no regular grid",
          .shows = shows,
          .keys = fmt::format(
              "type: apriltag\nfamily: {}\nborder_bits: {}\n", code.name, code.border_bits),
          .measure = {{"tags", "list of {id: 0, corners: [[x, y, z], ...]}"}}};
}

/// Whether one image shows the same number twice, as chance does where texture is read as tags.
bool HasRepeatedNumbers(const std::vector<std::vector<NumberedSquare>>& images) {
  return std::ranges::any_of(images, [](const std::vector<NumberedSquare>& squares) {
    std::set<int> ids;
    return !std::ranges::all_of(
        squares, [&](const NumberedSquare& square) { return ids.insert(square.id).second; });
  });
}

std::optional<TargetProposal> ProposeMarkers(const std::vector<Seen>& images, const Code& code) {
  std::vector<std::vector<NumberedSquare>> squares;
  std::map<int, size_t> ids;
  for (const Seen& seen : images) {
    const auto found = seen.markers.find(code);
    if (found == seen.markers.end()) continue;
    squares.push_back(found->second);
    for (const NumberedSquare& square : found->second) ++ids[square.id];
  }
  const std::optional<MarkerLayout> layout = internal::FindMarkerLayout(squares);
  TargetProposal proposal;
  if (layout && layout->kind == MarkerLayout::Kind::kCharuco) {
    proposal = CharucoProposal(code, *layout);
  } else if (layout && layout->kind == MarkerLayout::Kind::kRowsUp && code.border_bits > 0) {
    proposal = TagGridProposal(code, *layout);
  } else if (layout && code.border_bits == 0) {
    proposal = ArucoGrid(code, *layout);
  } else if (code.border_bits > 0) {
    // Chance reads tags of few bits in any texture, but not twice the same.
    constexpr size_t kOften = 2;
    const auto often = std::ranges::count_if(
        ids, [&](const auto& entry) { return entry.second >= std::min(kOften, images.size()); });
    if (often == 0 || HasRepeatedNumbers(squares)) return std::nullopt;
    proposal = LooseTags(code, ids.size());
  } else {
    return std::nullopt;
  }
  proposal.images = squares.size();
  return proposal;
}

std::vector<TargetProposal> Propose(const std::vector<Seen>& images) {
  std::vector<Code> codes;
  std::map<Code, size_t> counts;
  for (const Seen& seen : images) {
    for (const auto& [code, squares] : seen.markers) counts[code] += squares.size();
  }
  for (const auto& [code, count] : counts) codes.push_back(code);
  std::ranges::stable_sort(
      codes, std::ranges::greater(), [&](const Code& code) { return counts.at(code); });
  std::vector<TargetProposal> proposals;
  for (const Code& code : codes) {
    // The code of most markers is the board's; the others are chance.
    if (auto proposal = ProposeMarkers(images, code)) {
      proposals.push_back(std::move(*proposal));
      break;
    }
  }
  // The corners between the squares of a ChArUco board or an AprilGrid are no chessboard.
  const bool marked = !proposals.empty() && !proposals[0].word.empty();
  if (!marked) {
    if (auto chessboard = ProposeChessboard(images)) proposals.push_back(std::move(*chessboard));
    if (auto circles = ProposeCircles(images)) proposals.push_back(std::move(*circles));
  }
  // Without codes, texture looks like a small grid now and then, but not twice like the same.
  const size_t least = std::min<size_t>(2, (images.size() + 1) / 2);
  std::erase_if(proposals, [&](const TargetProposal& each) { return each.images < least; });
  std::ranges::stable_sort(proposals, std::ranges::greater(), &TargetProposal::images);
  return proposals;
}

}  // namespace

TargetProposals ProposeTargets(const std::vector<FrameImage>& images,
                               const ProposeOptions& options) {
  constexpr size_t kMost = 40;
  UseNoOpenCvThreads();
  TargetProposals proposals;
  proposals.looked_at = std::min(images.size(), kMost);
  std::vector<Seen> seen(proposals.looked_at);
  std::mutex mutex;
  size_t done = 0;
  bool stop = false;
  ParallelFor(seen.size(), options.threads, [&](size_t i) {
    {
      const std::lock_guard lock(mutex);
      if (stop) return;
    }
    try {
      seen[i] = Look(images[i * images.size() / seen.size()]);
    } catch (const Error&) {
      // An image that cannot be read shows no target; detection names it.
    }
    const std::lock_guard lock(mutex);
    ++done;
    if (options.progress && !options.progress(done, seen.size())) stop = true;
  });
  if (stop) throw Stopped();
  proposals.found = Propose(seen);
  return proposals;
}

}  // namespace plenocal
