// SPDX-License-Identifier: Apache-2.0

#include <apriltag/apriltag.h>
#include <apriltag/tag16h5.h>
#include <apriltag/tag25h9.h>
#include <apriltag/tag36h10.h>
#include <apriltag/tag36h11.h>
#include <apriltag/tagCircle21h7.h>
#include <apriltag/tagCircle49h12.h>
#include <apriltag/tagCustom48h12.h>
#include <apriltag/tagStandard41h12.h>
#include <apriltag/tagStandard52h13.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <map>
#include <memory>
#include <numbers>
#include <opencv2/imgcodecs.hpp>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "calib/base/error.h"
#include "detectors/detect.h"
#include "detectors/plenoptic/markers/focused_image_detector.h"
#include "detectors/templates/marker_template.h"
#include "detectors/types/marker_detectors.h"
#include "tests/detectors/render_pattern.h"
#include "tests/optional_data.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::Contains;
using ::testing::Each;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kWhite = 200, kBlack = 30;

struct FamilyMaker {
  const char* name;
  apriltag_family_t* (*create)();
  void (*destroy)(apriltag_family_t*);
};
constexpr std::array<FamilyMaker, 9> kFamilies{{
    {"tag16h5", tag16h5_create, tag16h5_destroy},
    {"tag25h9", tag25h9_create, tag25h9_destroy},
    {"tag36h10", tag36h10_create, tag36h10_destroy},
    {"tag36h11", tag36h11_create, tag36h11_destroy},
    {"tagCircle21h7", tagCircle21h7_create, tagCircle21h7_destroy},
    {"tagCircle49h12", tagCircle49h12_create, tagCircle49h12_destroy},
    {"tagCustom48h12", tagCustom48h12_create, tagCustom48h12_destroy},
    {"tagStandard41h12", tagStandard41h12_create, tagStandard41h12_destroy},
    {"tagStandard52h13", tagStandard52h13_create, tagStandard52h13_destroy},
}};

/// A tag as the library draws it, in the unit square with y up; white around.
class Drawing {
 public:
  Drawing(const FamilyMaker& maker, int id, int border_bits = 1) {
    apriltag_family_t* family = maker.create();
    family->width_at_border += 2 * (border_bits - 1);
    family->total_width += 2 * (border_bits - 1);
    for (std::uint32_t i = 0; i < family->nbits; ++i) {
      family->bit_x[i] += border_bits - 1;
      family->bit_y[i] += border_bits - 1;
    }
    width_ = family->width_at_border;
    total_ = family->total_width;
    image_u8_t* image = apriltag_to_image(family, id);
    for (int y = 0; y < total_; ++y) {
      for (int x = 0; x < total_; ++x) white_.push_back(image->buf[y * image->stride + x] > 0);
    }
    std::free(image->buf);
    std::free(image);
    maker.destroy(family);
  }
  double operator()(const Eigen::Vector2d& p) const {
    const int offset = (total_ - width_) / 2;
    const int x = static_cast<int>(std::floor(p.x() * width_)) + offset;
    const int y = static_cast<int>(std::floor((1 - p.y()) * width_)) + offset;
    if (x < 0 || y < 0 || x >= total_ || y >= total_) return kWhite;
    return white_.begin()[y * total_ + x] ? kWhite : kBlack;
  }

 private:
  int width_ = 0, total_ = 0;
  std::vector<bool> white_;
};

/// `columns` x `rows` tags of side 1 in steps of `pitch`, from id 0.
struct Board {
  Board(const FamilyMaker& maker, int n_columns, int n_rows, double pitch, bool kalibr = false)
      : columns(n_columns), rows(n_rows), step(pitch), squares(kalibr) {
    TagLayout layout;
    layout.family = maker.name;
    layout.border_bits = kalibr ? 2 : 1;
    layout.black_corner_squares = kalibr;
    for (int id = 0; id < columns * rows; ++id) {
      drawings.emplace_back(maker, id, layout.border_bits);
      layout.ids.push_back(id);
      const auto corners = Corners(id);
      for (std::size_t k = 0; k < 4; ++k) {
        target.markers[4 * id + static_cast<int>(k)] = {corners[k].x(), corners[k].y(), 0};
      }
    }
    target.layout = layout;
  }

  [[nodiscard]] std::array<Eigen::Vector2d, 4> Corners(int id) const {
    const int row = id / columns, column = id % columns;
    const Eigen::Vector2d at(column * step, row * step);
    return {at, at + Eigen::Vector2d(1, 0), at + Eigen::Vector2d(1, 1), at + Eigen::Vector2d(0, 1)};
  }

  double operator()(const Eigen::Vector2d& p) const {
    const double margin = (step - 1) / 2;  // of white on each side
    const int column = static_cast<int>(std::floor((p.x() + margin) / step));
    const int row = static_cast<int>(std::floor((p.y() + margin) / step));
    if (squares) {
      const auto in_gap = [&](double x, int n) {
        const double from_tag = x - std::floor(x / step) * step;
        return x > 1 - step && x < n * step && from_tag > 1;
      };
      if (in_gap(p.x(), columns) && in_gap(p.y(), rows)) return kBlack;
    }
    if (column < 0 || row < 0 || column >= columns || row >= rows) return kWhite;
    const Drawing& drawing = drawings.begin()[row * columns + column];
    return drawing({p.x() - column * step, p.y() - row * step});
  }

  int columns, rows;
  double step;
  bool squares;
  std::vector<Drawing> drawings;
  Target target;
};

/// A pinhole view of the board's plane: `side` px a tag, its middle in the image's middle, tilted
/// about an axis in the image and rolled.
Eigen::Matrix3d Camera(const Board& board,
                       cv::Size size,
                       double side,
                       double tilt_deg,
                       double roll_deg,
                       const Eigen::Vector2d& shift = {0.3, 0.4}) {
  constexpr double kFocal = 1000, kDegree = std::numbers::pi / 180;
  // The target's z points at the viewer when its tags are upright.
  const Eigen::Matrix3d R =
      (Eigen::AngleAxisd(tilt_deg * kDegree, Eigen::Vector3d(1, 0.5, 0).normalized()) *
       Eigen::AngleAxisd(roll_deg * kDegree, Eigen::Vector3d::UnitZ()) *
       Eigen::AngleAxisd(std::numbers::pi, Eigen::Vector3d::UnitX()))
          .toRotationMatrix();
  const Eigen::Vector3d middle(
      ((board.columns - 1) * board.step + 1) / 2, ((board.rows - 1) * board.step + 1) / 2, 0);
  Eigen::Matrix3d K, M;
  K << kFocal, 0, size.width / 2.0 + shift.x(), 0, kFocal, size.height / 2.0 + shift.y(), 0, 0, 1;
  M << R.col(0), R.col(1), Eigen::Vector3d(0, 0, kFocal / side) - R * middle;
  return K * M;
}

struct Score {
  double ours = 0, library = 0, chi2 = 0;  // sums over coordinates
  int n = 0;
  [[nodiscard]] double Ratio() const { return std::sqrt(ours / library); }
  [[nodiscard]] double Honesty() const { return chi2 / n; }
};

/// Compares with the truth, and with the library at full resolution where it finds the tag.
void Compare(const Board& board, const Eigen::Matrix3d& H, const cv::Mat& gray, Score* score) {
  const auto ours = MakeMarkerDetector(board.target)->Detect(gray);
  std::unique_ptr<apriltag_family_t, void (*)(apriltag_family_t*)> family(tag36h11_create(),
                                                                          tag36h11_destroy);
  std::unique_ptr<apriltag_detector_t, void (*)(apriltag_detector_t*)> detector(
      apriltag_detector_create(), apriltag_detector_destroy);
  detector->quad_decimate = 1;
  apriltag_detector_add_family_bits(detector.get(), family.get(), 1);
  cv::Mat copy = gray.clone();
  image_u8_t image{copy.cols, copy.rows, static_cast<std::int32_t>(copy.step), copy.data};
  zarray_t* detections = apriltag_detector_detect(detector.get(), &image);
  for (int i = 0; i < zarray_size(detections); ++i) {
    apriltag_detection_t* tag = nullptr;
    zarray_get(detections, i, &tag);
    if (tag->id >= board.columns * board.rows) continue;
    const auto corners = board.Corners(tag->id);
    for (int k = 0; k < 4; ++k) {
      const Eigen::Vector2d truth =
          (H * corners[static_cast<std::size_t>(k)].homogeneous()).hnormalized();
      const auto found = std::find_if(ours.markers.begin(), ours.markers.end(), [&](const auto& o) {
        return o.marker == 4 * tag->id + k;
      });
      ASSERT_NE(found, ours.markers.end()) << "tag " << tag->id << " corner " << k;
      const Eigen::Vector2d error = Eigen::Vector2d(found->values[0], found->values[1]) - truth;
      score->ours += error.squaredNorm();
      score->library +=
          (Eigen::Vector2d(tag->p[k][0] - 0.5, tag->p[k][1] - 0.5) - truth).squaredNorm();
      score->chi2 += error.squaredNorm() / (found->detector_sigma * found->detector_sigma);
      score->n += 2;
    }
  }
  apriltag_detections_destroy(detections);
}

TEST(TagDetector, FindsEveryFamilyWithItsCornersInOrder) {
  for (const FamilyMaker& maker : kFamilies) {
    SCOPED_TRACE(maker.name);
    const Board board(maker, 2, 2, 2.5);
    const cv::Size size(480, 480);
    const Eigen::Matrix3d H = Camera(board, size, 90, 20, 10);
    const cv::Mat gray = testing::Render(testing::View(board, H), size, {0.7, 2, 1, 4});
    const auto detections = MakeMarkerDetector(board.target)->Detect(gray);
    EXPECT_THAT(detections.failure, IsEmpty());
    ASSERT_THAT(detections.markers, SizeIs(16));
    int marker = 0;
    for (const Observation& o : detections.markers) {
      EXPECT_EQ(o.marker, marker++);
      const Eigen::Vector2d truth =
          (H * board.Corners(o.marker / 4)[static_cast<std::size_t>(o.marker % 4)].homogeneous())
              .hnormalized();
      EXPECT_NEAR(o.values[0], truth.x(), 0.1);
      EXPECT_NEAR(o.values[1], truth.y(), 0.1);
    }
  }
}

// The inner cells of a tag with a border of 1 bit lie where those of 2 bits are looked for, so that
// many tags are read all the same.
TEST(TagDetector, NamesABorderThatIsStatedTooWide) {
  const Board board(kFamilies[3], 6, 5, 1.4);
  Target target = board.target;
  std::get<TagLayout>(target.layout).border_bits = 2;
  const cv::Size size(800, 600);
  for (const double tilt : {0.0, 15.0, 30.0, 45.0}) {
    const Eigen::Matrix3d H = Camera(board, size, 70, tilt, 10);
    const cv::Mat gray = testing::Render(testing::View(board, H), size, {0.7, 2, 1, 4});
    EXPECT_THAT(MakeMarkerDetector(target)->Detect(gray).failure, HasSubstr("set border_bits: 1"))
        << tilt;
    EXPECT_THAT(MakeMarkerDetector(board.target)->Detect(gray).failure, IsEmpty()) << tilt;
  }
}

TEST(TagDetector, CornersAreBetterThanTheLibrarysAndTheirSigmasHonest) {
  const Board board(kFamilies[3], 2, 2, 1.5);
  Score all;
  for (const double side : {18.0, 30.0, 60.0, 100.0}) {
    for (const double blur : {0.5, 1.0, 1.5}) {
      if (side < 20 && blur > 0.5) continue;  // the library finds nothing there to compare with
      Score score;
      unsigned seed = 1;
      for (const double tilt : {0.0, 40.0, 60.0}) {
        if (side < 40 && tilt > 50) continue;
        for (const double noise : {3.0, 8.0}) {
          const int extent = static_cast<int>(side * 4) + 20;
          const cv::Size size(extent, extent);
          const Eigen::Matrix3d H =
              Camera(board, size, side, tilt, 17 + 30 * seed, {0.1 * seed, 0.3});
          Compare(board,
                  H,
                  testing::Render(testing::View(board, H), size, {blur, noise, seed++, 8}),
                  &score);
        }
      }
      EXPECT_LT(score.Ratio(), 0.8) << "side " << side << ", blur " << blur;
      RecordProperty("ratio", std::to_string(score.Ratio()));
      all.ours += score.ours;
      all.library += score.library;
      all.chi2 += score.chi2;
      all.n += score.n;
    }
  }
  EXPECT_LT(all.Ratio(), 0.6);
  EXPECT_GT(all.Honesty(), 0.7);
  EXPECT_LT(all.Honesty(), 1.4);
}

// Where noise alone is not searched, tags that stand out little from it must not be lost.
TEST(TagDetector, FindsDimTagsInNoise) {
  const Board board(kFamilies[3], 6, 5, 1.4);
  const cv::Size size(800, 600);
  const Eigen::Matrix3d H = Camera(board, size, 70, 20, 10);
  const cv::Mat clean = testing::Render(testing::View(board, H), size, {0.7, 0, 1, 4});
  cv::RNG random(3);
  const auto dimmed = [&](double contrast, double sigma) {
    cv::Mat dim, noise(size, CV_32F);
    clean.convertTo(dim, CV_32F, contrast / (kWhite - kBlack), 20);
    random.fill(noise, cv::RNG::NORMAL, 0, sigma);
    dim += noise;
    return dim;
  };
  const auto markers_in = [&](const cv::Mat& values) {
    cv::Mat gray;
    values.convertTo(gray, CV_8U);
    return MakeMarkerDetector(board.target)->Detect(gray).markers.size();
  };
  EXPECT_EQ(markers_in(dimmed(30, 8)), 4U * 30U);
  // In the shadow beside bright noise.
  cv::Mat both(size.height, 3 * size.width, CV_32F);
  cv::RNG(4).fill(both, cv::RNG::NORMAL, 180, 6);
  dimmed(12, 1.5).copyTo(both(cv::Rect(cv::Point(0, 0), size)));
  EXPECT_EQ(markers_in(both), 4U * 30U);
}

TEST(TagDetector, FindsAllOfAKalibrGrid) {
  const Board board(kFamilies[3], 6, 6, 1.3, true);
  for (const double side : {30.0, 60.0}) {
    const int extent = static_cast<int>(side * 12);
    const cv::Size size(extent, extent);
    const Eigen::Matrix3d H = Camera(board, size, side, 30, 20);
    const auto detections =
        MakeMarkerDetector(board.target)
            ->Detect(testing::Render(testing::View(board, H), size, {0.9, 3, 1, 4}));
    EXPECT_THAT(detections.markers, SizeIs(4 * 36)) << side;
    double sum = 0;
    for (const Observation& o : detections.markers) {
      const Eigen::Vector2d truth =
          (H * board.Corners(o.marker / 4)[static_cast<std::size_t>(o.marker % 4)].homogeneous())
              .hnormalized();
      sum += (Eigen::Vector2d(o.values[0], o.values[1]) - truth).squaredNorm() /
             (o.detector_sigma * o.detector_sigma);
    }
    EXPECT_LT(sum / (2.0 * static_cast<double>(detections.markers.size())), 1.6);
  }
}

TEST(TagDetector, ResultsOnHardImagesAreTheSameAsBefore) {
  const Board kalibr(kFamilies[3], 5, 4, 1.3, true), plain(kFamilies[8], 3, 3, 1.8);
  const cv::Size size(420, 360);
  const auto view = [&](const Board& board,
                        double side,
                        double tilt,
                        double roll,
                        testing::RenderOptions options) {
    options.supersampling = 4;
    return testing::Render(
        testing::View(board, Camera(board, size, side, tilt, roll)), size, options);
  };
  cv::Mat partly_hidden = view(kalibr, 54, 20, 10, {.blur = 1, .noise = 6});
  partly_hidden(cv::Rect(150, 90, 60, 50)) = 120;
  testing::ExpectDigests(
      *MakeMarkerDetector(kalibr.target),
      {view(kalibr, 18, 10, 40, {.blur = 0.5, .noise = 2}),
       view(kalibr, 54, 62, 10, {.blur = 0.8, .noise = 3}),
       view(kalibr, 54, 20, 100, {.blur = 2.6, .noise = 3}),
       view(kalibr, 54, 20, 10, {.blur = 0.8, .noise = 40}),
       view(kalibr, 110, 20, 10, {.blur = 0.8, .noise = 3}),
       partly_hidden,
       testing::UnevenlyLit(view(kalibr, 54, 30, -20, {.blur = 0.6, .noise = 3}), 0.2),
       0.12 * view(kalibr, 54, 30, -20, {.blur = 0.9, .noise = 2}) + 60},
      {-20232.9686,
       -19695.6897,
       -20334.9955,
       -19281.3860,
       -1800.1483,
       -19826.4015,
       -18699.1828,
       -18683.1825});
  testing::ExpectDigests(*MakeMarkerDetector(plain.target),
                         {view(plain, 22, 20, 40, {.blur = 0.6, .noise = 3}),
                          view(plain, 60, 55, 200, {.blur = 1.2, .noise = 12}),
                          view(plain, 150, 40, -70, {.blur = 2, .noise = 5})},
                         {-5378.8229, -5022.4264, -188.4473});
}

TEST(FocusedImageDetector, FindsTagsThatAreTooBlurredForTheDetector) {
  const Board board(kFamilies[3], 5, 5, 1.3, true);
  const double side = 42;
  const cv::Size size(420, 420);
  const Eigen::Matrix3d H = Camera(board, size, side, 30, 20);
  const cv::Mat blurred = testing::Render(testing::View(board, H), size, {2.9, 0, 1, 4});
  ASSERT_LT(MakeMarkerDetector(board.target)->Detect(blurred).markers.size(), 25U);
  cv::Mat focused;
  blurred.convertTo(focused, CV_32F);
  const MarkerDetections found = internal::FocusedImageDetector(board.target).Detect(focused);
  EXPECT_THAT(found.markers, SizeIs(4 * 25));
  for (const Observation& o : found.markers) {
    const Eigen::Vector2d truth =
        (H * board.Corners(o.marker / 4)[static_cast<std::size_t>(o.marker % 4)].homogeneous())
            .hnormalized();
    EXPECT_LT((Eigen::Vector2d(o.values[0], o.values[1]) - truth).norm(), 1) << o.marker;
  }
}

// Blurred tags hang together with the squares at their corners, so that the library reads few; and
// a fisheye bends the board more than a homography by tags from all over it can follow.
TEST(TagDetector, FindsTheNeighboursOfFewTagsInAFisheye) {
  const Board board(kFamilies[3], 6, 6, 1.3, true);
  const cv::Size size(1280, 1024);
  const Eigen::Vector2d middle(640, 512);
  constexpr double kFocal = 380;
  const Eigen::Matrix3d R =
      Eigen::Quaterniond(0.697, 0.645, 0.134, 0.283).normalized().toRotationMatrix();
  const Eigen::Vector3d camera(2.46, 4.88, 3.36);  // in sides of a tag
  cv::Mat gray = testing::Render(
      [&](const Eigen::Vector2d& pixel) {
        const Eigen::Vector2d q = (pixel - middle) / kFocal;
        const double theta = q.norm();
        const Eigen::Vector2d aside = std::sin(theta) / std::max(theta, 1e-9) * q;
        const Eigen::Vector3d ray = R * Eigen::Vector3d(aside.x(), aside.y(), std::cos(theta));
        if (ray.z() >= 0) return kBlack;
        return board((camera - camera.z() / ray.z() * ray).head<2>());
      },
      size,
      {.blur = 2, .noise = 2, .supersampling = 3});
  cv::erode(gray, gray, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  const auto found = MakeMarkerDetector(board.target)->Detect(gray).markers;
  int whole = 0;
  for (int id = 0; id < 36; ++id) {
    int inside = 0;
    for (const Eigen::Vector2d& corner : board.Corners(id)) {
      const Eigen::Vector3d seen =
          R.transpose() * (Eigen::Vector3d(corner.x(), corner.y(), 0) - camera);
      const double theta = std::atan2(seen.head<2>().norm(), seen.z());
      const Eigen::Vector2d at = middle + kFocal * theta * seen.head<2>().normalized();
      inside += at.x() > 10 && at.y() > 10 && at.x() < 1269 && at.y() < 1013;
    }
    if (inside < 4) continue;
    ++whole;
    EXPECT_TRUE(std::ranges::any_of(found, [&](const auto& o) { return o.marker / 4 == id; }))
        << id;
  }
  EXPECT_GT(whole, 15);
}

/// RMS of the coordinates' errors, px. `image_of`: of a point of the board's plane.
double RmsError(const Board& board,
                const std::vector<Observation>& markers,
                const std::function<Eigen::Vector2d(const Eigen::Vector2d&)>& image_of) {
  double sum = 0;
  for (const Observation& o : markers) {
    const auto corners = board.Corners(o.marker / 4);
    const Eigen::Vector2d truth = image_of(corners[static_cast<std::size_t>(o.marker % 4)]);
    sum += (Eigen::Vector2d(o.values[0], o.values[1]) - truth).squaredNorm();
  }
  return std::sqrt(sum / (2 * static_cast<double>(markers.size())));
}

TEST(TagDetector, CrossingsOfAKalibrGridDoNotMoveWhenBlackSpreads) {
  const Board board(kFamilies[3], 3, 3, 1.3, true);
  const cv::Size size(480, 480);
  const Eigen::Matrix3d H = Camera(board, size, 80, 25, 10);
  // 4 x 4 pixels of a large image make one; black grows by a quarter of that on all sides.
  Eigen::Matrix3d large;
  large << 4, 0, 1.5, 0, 4, 1.5, 0, 0, 1;
  cv::Mat sharp =
      testing::Render(testing::View(board, large * H), size * 4, {.blur = 1, .supersampling = 2});
  cv::erode(sharp, sharp, cv::getStructuringElement(cv::MORPH_RECT, {3, 3}));
  cv::Mat gray;
  cv::resize(sharp, gray, size, 0, 0, cv::INTER_AREA);
  cv::GaussianBlur(gray, gray, {0, 0}, 0.7);
  const auto found = MakeMarkerDetector(board.target)->Detect(gray);
  ASSERT_THAT(found.markers, SizeIs(36));
  const auto image_of = [&](const Eigen::Vector2d& p) -> Eigen::Vector2d {
    return (H * p.homogeneous()).hnormalized();
  };
  EXPECT_LT(RmsError(board, found.markers, image_of), 0.05);
}

TEST(TagDetector, GoesByTheSquaresThatTheImageShows) {
  for (const bool printed : {true, false}) {
    const Board board(kFamilies[3], 3, 3, 1.3, printed);
    Target other = board.target;
    std::get<TagLayout>(other.layout).black_corner_squares = !printed;
    for (const double side : {30.0, 80.0}) {
      const int extent = static_cast<int>(6 * side);
      const cv::Size size(extent, extent);
      const Eigen::Matrix3d H = Camera(board, size, side, 25, 10);
      const cv::Mat gray =
          testing::Render(testing::View(board, H), size, {.blur = 0.7, .noise = 1});
      const auto expected = MakeMarkerDetector(board.target)->Detect(gray).markers;
      const auto found = MakeMarkerDetector(other)->Detect(gray).markers;
      ASSERT_THAT(expected, SizeIs(36)) << side;
      ASSERT_THAT(found, SizeIs(36)) << side;
      for (std::size_t i = 0; i < found.size(); ++i) {
        EXPECT_NEAR(found[i].values[0], expected[i].values[0], 2e-3) << printed << ", " << side;
        EXPECT_NEAR(found[i].values[1], expected[i].values[1], 2e-3) << printed << ", " << side;
      }
      const auto templates = internal::MakeMarkerTemplates(other, found, gray);
      ASSERT_THAT(templates, SizeIs(36));
      auto drawing = std::get<internal::CellTemplate>(templates[0].pattern);
      // Half a cell outside of the lower left corner, in both directions.
      internal::Lanes x{}, y{};
      x[0] = static_cast<float>(templates[0].margin) - 0.5f;
      y[0] = static_cast<float>(drawing.size() - templates[0].margin) + 0.5f;
      internal::CellTemplate::Drawn drawn;
      drawing.Draw(Eigen::Matrix3f::Identity(), 0.05f, 0, x, y, &drawn);
      EXPECT_NEAR(drawn.value[0], printed ? -1 : 1, 0.01) << side;
    }
  }
}

TEST(TagDetector, AllImagesOfACameraTogetherSayHowItsLensBendsEdges) {
  // Few tags, so that one image alone says little.
  const Board board(kFamilies[3], 2, 2, 1.4);
  const cv::Size size(400, 320);
  const Eigen::Vector2d axis(205, 150);
  constexpr double kBarrel = 1.5e-6;  // px^-2
  const testing::TemporaryFolder folder;
  std::vector<FrameImage> images;
  std::vector<std::function<Eigen::Vector2d(const Eigen::Vector2d&)>> image_of;
  double alone = 0;
  const auto detector = MakeMarkerDetector(board.target);
  constexpr int kImages = 6;
  for (int i = 0; i < kImages; ++i) {
    const Eigen::Matrix3d H =
        Camera(board, size, 44, 10 + 3 * i, 60 * i, {90.0 * (i % 3) - 90, 60.0 * (i % 2) - 30});
    const testing::GrayFunction ideal = testing::View(board, H);
    const cv::Mat gray = testing::Render(
        [&](const Eigen::Vector2d& p) {
          const Eigen::Vector2d q = p - axis;
          return ideal(axis + q * (1 + kBarrel * q.squaredNorm()));
        },
        size,
        {.blur = 0.7, .noise = 6, .seed = static_cast<unsigned>(i)});
    image_of.push_back([H, axis](const Eigen::Vector2d& p) -> Eigen::Vector2d {
      const Eigen::Vector2d straight = (H * p.homogeneous()).hnormalized() - axis;
      Eigen::Vector2d q = straight;
      for (int k = 0; k < 50; ++k) q = straight / (1 + kBarrel * q.squaredNorm());
      return axis + q;
    });
    alone += RmsError(board, detector->Detect(gray).markers, image_of.back()) / kImages;
    images.push_back({std::to_string(i), folder / (std::to_string(i) + ".png")});
    cv::imwrite(images.back().path.string(), gray);
  }
  const ImageDetections together = DetectImages(images, board.target, CameraOptics::kOrdinary, {});
  ASSERT_THAT(together.views, SizeIs(kImages));
  double error = 0;
  for (std::size_t i = 0; i < kImages; ++i) {
    error += RmsError(board, together.views[i].observations, image_of[i]) / kImages;
  }
  EXPECT_LT(error, 0.9 * alone);
  EXPECT_LT(error, 0.03);
}

TEST(TagDetector, SaysWhichTagsAreNotOnTheTargetOrThereTwice) {
  const Board board(kFamilies[3], 3, 1, 1.5);
  const cv::Size size(400, 200);
  const Eigen::Matrix3d H = Camera(board, size, 60, 0, 0);
  // The third tag shows the second one's pattern.
  Board printed = board;
  printed.drawings[2] = printed.drawings[1];
  const auto twice = MakeMarkerDetector(board.target)
                         ->Detect(testing::Render(testing::View(printed, H), size, {0.7, 2, 1, 4}));
  EXPECT_THAT(twice.left_out, Contains("tag 1 appears twice in the image"));
  EXPECT_THAT(twice.markers, SizeIs(4));

  printed.drawings[2] = Drawing(kFamilies[3], 99);
  const auto other = MakeMarkerDetector(board.target)
                         ->Detect(testing::Render(testing::View(printed, H), size, {0.7, 2, 1, 4}));
  EXPECT_THAT(other.left_out, Contains("tag 99 (tag36h11) is not on the target"));
  EXPECT_THAT(other.markers, SizeIs(8));
}

TEST(TagDetector, ImagesWithoutTagsGiveAFailureAndNoMarkers) {
  for (const FamilyMaker& maker : {kFamilies[0], kFamilies[3], kFamilies[8]}) {
    SCOPED_TRACE(maker.name);
    const Board board(maker, 2, 2, 1.5);
    const auto detector = MakeMarkerDetector(board.target);
    cv::Mat noise(480, 640, CV_8U);
    cv::RNG(7).fill(noise, cv::RNG::UNIFORM, 0, 256);
    for (const cv::Mat& gray : {cv::Mat(),
                                cv::Mat(1, 1, CV_8U, cv::Scalar(7)),
                                cv::Mat(8, 8, CV_8U, cv::Scalar(7)),
                                cv::Mat(3, 300, CV_8U, cv::Scalar(7)),
                                cv::Mat(240, 320, CV_8U, cv::Scalar(99)),
                                noise}) {
      const auto detections = detector->Detect(gray);
      EXPECT_THAT(detections.markers, IsEmpty()) << gray.size();
      EXPECT_FALSE(detections.failure.empty()) << gray.size();
    }
  }
}

TEST(TagDetector, NamesTheOtherBorderWhenThatIsWhatTheImageShows) {
  const Board kalibr(kFamilies[3], 2, 2, 1.5, true);
  Board board(kFamilies[3], 2, 2, 1.5);
  const cv::Size size(300, 300);
  board.squares = false;
  Board printed = kalibr;
  printed.squares = false;
  const Eigen::Matrix3d H = Camera(kalibr, size, 80, 10, 5);
  const auto detections =
      MakeMarkerDetector(board.target)
          ->Detect(testing::Render(testing::View(printed, H), size, {0.7, 2, 1, 4}));
  EXPECT_THAT(detections.failure, HasSubstr("set border_bits: 2"));
}

TEST(TagDetector, RefusesLayoutsThatNoTagHas) {
  Target target;
  TagLayout layout;
  layout.family = "tagStandard41h12";
  layout.border_bits = 2;
  target.layout = layout;
  EXPECT_THROW(MakeMarkerDetector(target), Error);
  layout.family = "tag36h12";
  layout.border_bits = 1;
  target.layout = layout;
  EXPECT_THROW(MakeMarkerDetector(target), Error);
  layout.family = "tag16h5";
  layout.ids = {30};
  target.layout = layout;
  EXPECT_THROW(MakeMarkerDetector(target), Error);
}

TEST(TagDetector, ResultsDoNotDependOnEarlierImages) {
  const Board board(kFamilies[3], 3, 2, 1.5);
  const cv::Size size(320, 240);
  const auto render = [&](double tilt) {
    return testing::Render(
        testing::View(board, Camera(board, size, 50, tilt, 5)), size, {0.7, 4, 1, 4});
  };
  const cv::Mat first = render(10), second = render(50);
  const auto detector = MakeMarkerDetector(board.target);
  detector->Detect(first);
  const auto after = detector->Detect(second);
  const auto alone = MakeMarkerDetector(board.target)->Detect(second);
  ASSERT_EQ(after.markers.size(), alone.markers.size());
  for (std::size_t i = 0; i < alone.markers.size(); ++i) {
    EXPECT_EQ(after.markers[i].values, alone.markers[i].values);
    EXPECT_EQ(after.markers[i].detector_sigma, alone.markers[i].detector_sigma);
  }
}

TEST(MarkerDetector, RefusesTargetsOfTypeMarkers) {
  Target target;
  target.layout = MarkersLayout{};
  EXPECT_THAT(testing::RefusalOf([&] { MakeMarkerDetector(target); }),
              HasSubstr("detections: file.csv"));
}

// Real and simulated sets.

Target KalibrGrid(double size) {
  Target target;
  TagLayout layout;
  layout.family = "tag36h11";
  layout.border_bits = 2;
  layout.black_corner_squares = true;
  for (int id = 0; id < 36; ++id) {
    layout.ids.push_back(id);
    const int row = id / 6, column = id % 6;
    const Eigen::Vector3d at(column * 1.3 * size, row * 1.3 * size, 0);
    target.markers[4 * id] = at;
    target.markers[4 * id + 1] = at + Eigen::Vector3d(size, 0, 0);
    target.markers[4 * id + 2] = at + Eigen::Vector3d(size, size, 0);
    target.markers[4 * id + 3] = at + Eigen::Vector3d(0, size, 0);
  }
  target.layout = layout;
  return target;
}

/// The numbers of a line, whatever stands between them.
std::vector<double> Numbers(std::string line) {
  for (std::size_t i = 0; i < line.size(); ++i) {
    const bool exponent =
        line[i] == 'e' && i > 0 &&
        std::string_view("0123456789").find(line[i - 1]) != std::string_view::npos;
    if (!exponent && std::string_view("0123456789.-").find(line[i]) == std::string_view::npos)
      line[i] = ' ';
  }
  std::istringstream stream(line);
  std::vector<double> numbers;
  for (double number; stream >> number;) numbers.push_back(number);
  return numbers;
}

TEST(TagDetectorOnRealImages, FindsMoreCornersThanKalibrAndAgreesWithIt) {
  const std::filesystem::path folder = OptionalData("frames/aprilgrid_d435i_mocap");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << Absent(folder);
  const auto detector = MakeMarkerDetector(KalibrGrid(0.088));
  std::size_t ours = 0;
  int n = 0;
  Eigen::Vector2d sum(0, 0);
  std::vector<double> apart;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "grid0/cam0/data")) {
    const auto image = folder / "cam0/data" / entry.path().stem().concat(".jpg");
    const auto detections = detector->Detect(cv::imread(image.string(), cv::IMREAD_GRAYSCALE));
    ours += detections.markers.size();
    std::map<int, Eigen::Vector2d> found;
    for (const Observation& o : detections.markers) found[o.marker] = {o.values[0], o.values[1]};
    std::ifstream stream(entry.path());
    std::string line;
    std::getline(stream, line);
    while (std::getline(stream, line)) {
      const std::vector<double> row = Numbers(line);
      const auto at = found.find(4 * static_cast<int>(row.at(10)) + static_cast<int>(row.at(11)));
      if (at == found.end()) continue;
      const Eigen::Vector2d difference = at->second - Eigen::Vector2d(row[5], row[6]);
      apart.push_back(difference.norm());
      if (difference.norm() > 2) continue;  // about ten of 4000; whose error is not known
      sum += difference;
      ++n;
    }
  }
  EXPECT_GE(ours, 4008U);
  ASSERT_GT(n, 3900);
  // Half a pixel of offset would show; Kalibr's own noise is 0.2 px a coordinate.
  EXPECT_LT((sum / n).norm(), 0.02);
  std::nth_element(apart.begin(), apart.begin() + n / 2, apart.end());
  EXPECT_LT(apart[static_cast<std::size_t>(n / 2)], 0.3);
}

TEST(TagDetectorOnRealImages, FindsWhatOpenCvFindsOnAPhonesPhotographs) {
  const std::filesystem::path folder = OptionalData("frames/aprilgrid_tag36h11_phone4");
  constexpr std::size_t kTags = 36;  // in both (reference_opencv.json)
  const auto detector = MakeMarkerDetector(KalibrGrid(0.022));
  for (const char* name : {"tag36H11_6x6_1.jpg", "tag36H11_6x6_4.jpg"}) {
    const cv::Mat image = cv::imread((folder / name).string(), cv::IMREAD_GRAYSCALE);
    ASSERT_FALSE(image.empty()) << folder / name;
    EXPECT_EQ(detector->Detect(image).markers.size(), 4 * kTags) << name;
  }
}

TEST(TagDetectorOnRealImages, FindsEveryTagInViewOfTheSimulatedRig) {
  const std::filesystem::path folder = OptionalData("sim_small");
  if (!std::filesystem::exists(folder)) GTEST_SKIP() << Absent(folder);
  Target target;
  TagLayout layout;
  layout.family = "tag36h11";
  std::ifstream tags(folder / "target.yaml");
  for (std::string line; std::getline(tags, line);) {
    if (line.find("{id:") == std::string::npos) continue;
    const auto numbers = Numbers(line.substr(line.find("id:") + 3));
    const int id = static_cast<int>(numbers.at(0));
    ASSERT_EQ(numbers.size(), 13U) << line;
    const std::vector<double> xyz(numbers.begin() + 1, numbers.end());
    layout.ids.push_back(id);
    for (int k = 0; k < 4; ++k) target.markers[4 * id + k] = Eigen::Vector3d(xyz.data() + 3 * k);
  }
  target.layout = layout;
  const auto detector = MakeMarkerDetector(target);
  std::ifstream frames(folder / "truth/frames.csv");
  std::string line;
  std::getline(frames, line);
  while (std::getline(frames, line)) {
    std::istringstream row(line);
    std::string name, kind, left;
    std::getline(row, name, ',');
    std::getline(row, kind, ',');
    std::getline(row, left, ',');
    const auto image = folder / "left" / (name + ".png");
    const auto detections = detector->Detect(cv::imread(image.string(), cv::IMREAD_GRAYSCALE));
    EXPECT_GE(detections.markers.size(), 4 * std::stoul(left)) << name;
  }
}

}  // namespace TEST_FILE
}  // namespace plenocal
