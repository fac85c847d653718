// SPDX-License-Identifier: Apache-2.0
//
// Small tags: where the blur is as wide as a bit, no edge can be told from the next one, but all of
// them together still say where the tag is. The whole tag, whose bits are known, is drawn through a
// homography, blurred, and fitted to the image.
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <optional>
#include <vector>

#include "detectors/tag_edges.h"

namespace plenocal::internal {

/// Maps (0, 0), (1, 0), (1, 1), (0, 1) to the corners; P. Heckbert, "Fundamentals of Texture
/// Mapping and Image Warping", 1989.
inline Eigen::Matrix3d UnitSquareHomography(const Quad& q) {
  const Eigen::Vector2d sum = q[0] - q[1] + q[2] - q[3];
  Eigen::Matrix2d d;
  d << q[1] - q[2], q[3] - q[2];
  const Eigen::Vector2d g = d.inverse() * sum;
  Eigen::Matrix3d h;
  h << q[1] - q[0] + g[0] * q[1], q[3] - q[0] + g[1] * q[3], q[0], g[0], g[1], 1;
  return h;
}

/// A tag's drawing fitted to the image:
///
///   I(x) = (1 + g . y) (m + k T(x; corners, w)),   y = (x - centre) / side,
///
/// T is 1 in the colour outside the tag, -1 in the other, averaged over the pixel and blurred by a
/// Gaussian of standard deviation w (px).
class TagTemplate {
 public:
  TagTemplate(const cv::Mat& gray, const SeenTag& tag, const TagBorder& border)
      : gray_(gray), border_(border) {
    state_.corners = tag.corners;
    const int n = border.width + 2;
    cells_.assign(static_cast<std::size_t>(n) * n, 1.f);
    for (int y = 0; y < border.width; ++y) {
      for (int x = 0; x < border.width; ++x) {
        cells_[(y + 1) * n + x + 1] = tag.bits[y * border.width + x] ? 1.f : -1.f;
      }
    }
    if (border.corner_squares) {
      for (const int corner : {0, n - 1, n * (n - 1), n * n - 1}) cells_[corner] = -1;
    }
    side_ = std::sqrt(Area());
    // Room for half a bit around the tag, for the tag to move in, and for derivatives.
    const double room = 2 + side_ / border.width;
    Eigen::AlignedBox2d box;
    for (const auto& c : state_.corners) box.extend(c);
    const cv::Point from(static_cast<int>(std::floor(box.min().x() - room)),
                         static_cast<int>(std::floor(box.min().y() - room)));
    const cv::Point to(static_cast<int>(std::ceil(box.max().x() + room)) + 1,
                       static_cast<int>(std::ceil(box.max().y() + room)) + 1);
    region_ = cv::Rect(from, to) & cv::Rect(0, 0, gray.cols, gray.rows);
    centre_ = box.center();
  }

  /// Moves the tag by whole pixels to where the image resembles it most, at most `reach` away.
  void Search(int reach) {
    if (!Draw()) return;
    double best = -1;
    Eigen::Vector2d best_shift(0, 0);
    for (int dy = -reach; dy <= reach; ++dy) {
      for (int dx = -reach; dx <= reach; ++dx) {
        Correlation all;
        for (const Pixel& p : pixels_) {
          const int x = p.x + dx, y = p.y + dy;
          if (x < 0 || y < 0 || x >= gray_.cols || y >= gray_.rows) continue;
          all.Add(gray_.at<unsigned char>(y, x), p.value);
        }
        const double r = all.Coefficient() * border_.outside_sign;
        if (r > best) {
          best = r;
          best_shift = {dx, dy};
        }
      }
    }
    for (auto& c : state_.corners) c += best_shift;
    centre_ += best_shift;
    region_ =
        (region_ + cv::Point(static_cast<int>(best_shift.x()), static_cast<int>(best_shift.y()))) &
        cv::Rect(0, 0, gray_.cols, gray_.rows);
  }

  /// Levenberg-Marquardt. False when it does not converge, or to something else than the tag.
  bool Fit() {
    const Quad start = state_.corners;
    if (!Draw() || pixels_.size() <= kParameters) return false;
    StartLevels();
    // Once more with the pixels that the first result covers.
    Descend();
    if (!Draw() || pixels_.size() <= kParameters) return false;
    const Equations now = Descend();
    const double variance = now.mean_square * static_cast<double>(pixels_.size()) /
                            static_cast<double>(pixels_.size() - kParameters);
    const Matrix covariance = variance * now.information.ldlt().solve(Matrix::Identity());
    double moved = 0;
    for (int k = 0; k < 4; ++k) {
      sigma_[k] = std::sqrt(covariance.diagonal().segment<2>(2 * k).mean());
      moved = std::max(moved, (state_.corners[k] - start[k]).norm());
      // Also false for NaN.
      if (!(sigma_[k] < side_ / 4)) return false;
    }
    return moved < side_ / 2 && state_.contrast * border_.outside_sign > 0;
  }

  [[nodiscard]] const Quad& corners() const { return state_.corners; }
  [[nodiscard]] double sigma(int corner) const { return sigma_[static_cast<std::size_t>(corner)]; }

  /// Correlation of image and drawing over the tag's data, without its border.
  [[nodiscard]] double DataCorrelation() const {
    Correlation data;
    for (const Pixel& p : pixels_) {
      if (p.data) data.Add(gray_.at<unsigned char>(p.y, p.x), p.value);
    }
    return data.Coefficient() * border_.outside_sign;
  }

 private:
  static constexpr int kParameters = 13;
  static constexpr int kFine = 3;  // drawn at three times the image's resolution
  static constexpr double kLeastBlur = 0.2, kMostBlur = 4;
  using Vector = Eigen::Matrix<double, kParameters, 1>;
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;

  struct Pixel {
    int x, y;
    double value;                        ///< T
    Eigen::Vector2d slope;               ///< of T
    double by_blur;                      ///< derivative of T by w
    Eigen::Matrix<double, 2, 8> motion;  ///< of the tag's point at the pixel by the corners
    bool data;
  };

  struct Correlation {
    double n = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
    void Add(double a, double b) { n += 1, x += a, y += b, xx += a * a, yy += b * b, xy += a * b; }
    [[nodiscard]] double Coefficient() const {
      const double vx = n * xx - x * x, vy = n * yy - y * y;
      return vx > 0 && vy > 0 ? (n * xy - x * y) / std::sqrt(vx * vy) : 0;
    }
  };

  [[nodiscard]] double Area() const {
    const Eigen::Vector2d a = state_.corners[2] - state_.corners[0],
                          b = state_.corners[3] - state_.corners[1];
    return std::abs(a.x() * b.y() - a.y() * b.x()) / 2;
  }

  /// Draws the tag and fills `pixels_`, those on the tag as it is drawn or as it was drawn before.
  /// False when there is no such drawing.
  bool Draw(bool choose_pixels = true) {
    pixels_.clear();
    if (region_.width < 4 || region_.height < 4) return false;
    const Eigen::Matrix3d h = UnitSquareHomography(state_.corners);
    if (!h.allFinite() || std::abs(h.determinant()) < 1e-9) return false;
    const Eigen::Matrix3d inverse = h.inverse();
    if (choose_pixels) mask_ = inverse;
    const int n = border_.width + 2;
    // A fine pixel's extent in bits, over which a boundary between bits is spread.
    const double spread_u = border_.width / (kFine *
                                             ((state_.corners[1] - state_.corners[0]).norm() +
                                              (state_.corners[2] - state_.corners[3]).norm()) /
                                             2);
    const double spread_v = border_.width / (kFine *
                                             ((state_.corners[3] - state_.corners[0]).norm() +
                                              (state_.corners[2] - state_.corners[1]).norm()) /
                                             2);
    const auto between = [n](double at, double spread, int* low, int* high) {
      // The two bits nearest to `at` and the share of the second.
      const double boundary = std::round(at);
      *low = std::clamp(static_cast<int>(boundary) - 1, 0, n - 1);
      *high = std::clamp(static_cast<int>(boundary), 0, n - 1);
      return std::clamp((at - boundary) / spread + 0.5, 0.0, 1.0);
    };
    fine_.create(region_.height * kFine, region_.width * kFine, CV_32F);
    for (int i = 0; i < fine_.rows; ++i) {
      auto* row = fine_.ptr<float>(i);
      for (int j = 0; j < fine_.cols; ++j) {
        const Eigen::Vector3d at = inverse * Eigen::Vector3d(region_.x - 0.5 + (j + 0.5) / kFine,
                                                             region_.y - 0.5 + (i + 0.5) / kFine,
                                                             1);
        const double u = at.x() / at.z() * border_.width + 1;
        const double v = (1 - at.y() / at.z()) * border_.width + 1;
        int left, right, top, bottom;
        const double share_u = between(std::clamp(u, 0.0, n * 1.0), spread_u, &left, &right);
        const double share_v = between(std::clamp(v, 0.0, n * 1.0), spread_v, &top, &bottom);
        row[j] = static_cast<float>((1 - share_v) * ((1 - share_u) * cells_[top * n + left] +
                                                     share_u * cells_[top * n + right]) +
                                    share_v * ((1 - share_u) * cells_[bottom * n + left] +
                                               share_u * cells_[bottom * n + right]));
      }
    }
    const int kernel = 2 * static_cast<int>(std::ceil(4 * state_.blur * kFine)) + 1;
    cv::GaussianBlur(fine_, fine_, {kernel, kernel}, state_.blur * kFine, 0, cv::BORDER_REPLICATE);

    std::array<Eigen::Matrix3d, 8> moved;
    constexpr double kMove = 1e-4;
    for (int k = 0; k < 8; ++k) {
      Quad quad = state_.corners;
      quad[k / 2][k % 2] += kMove;
      moved[k] = UnitSquareHomography(quad);
    }
    const double margin = 0.5 / border_.width,
                 data_from = static_cast<double>(border_.ring) / border_.width;
    for (int y = 1; y + 1 < region_.height; ++y) {
      for (int x = 1; x + 1 < region_.width; ++x) {
        const Eigen::Vector2d at(region_.x + x, region_.y + y);
        const Eigen::Vector2d unit = (inverse * at.homogeneous()).hnormalized();
        const double from_middle =
            ((mask_ * at.homogeneous()).hnormalized().array() - 0.5).abs().maxCoeff();
        if (from_middle > 0.5 + margin) continue;
        Pixel p;
        p.x = region_.x + x;
        p.y = region_.y + y;
        p.data = from_middle < 0.5 - data_from;
        p.value = 0;
        p.slope.setZero();
        p.by_blur = 0;
        const int i_0 = y * kFine, j_0 = x * kFine;
        for (int i = i_0; i < i_0 + kFine; ++i) {
          for (int j = j_0; j < j_0 + kFine; ++j) p.value += fine_.at<float>(i, j);
        }
        p.value /= kFine * kFine;
        // Derivatives of a pixel's mean are differences between its sides; that by the blur follows
        // from the heat equation, dT/dw = w (T_xx + T_yy).
        for (int k = 0; k < kFine; ++k) {
          const auto* row = fine_.ptr<float>(i_0 + k);
          const double left = row[j_0 - 1], left_in = row[j_0];
          const double right_in = row[j_0 + kFine - 1], right = row[j_0 + kFine];
          p.slope.x() += (right + right_in - left - left_in) / (2 * kFine);
          const double top = fine_.at<float>(i_0 - 1, j_0 + k),
                       top_in = fine_.at<float>(i_0, j_0 + k);
          const double bottom_in = fine_.at<float>(i_0 + kFine - 1, j_0 + k);
          const double bottom = fine_.at<float>(i_0 + kFine, j_0 + k);
          p.slope.y() += (bottom + bottom_in - top - top_in) / (2 * kFine);
          p.by_blur += state_.blur * ((right - right_in) - (left_in - left) + (bottom - bottom_in) -
                                      (top_in - top));
        }
        for (int k = 0; k < 8; ++k) {
          p.motion.col(k) = ((moved[k] * unit.homogeneous()).hnormalized() - at) / kMove;
        }
        pixels_.push_back(p);
      }
    }
    return !pixels_.empty();
  }

  struct State {
    Quad corners;
    double level = 0, contrast = 0, blur = 0.8;
    Eigen::Vector2d gradient{0, 0};
  };

  struct Equations {
    Matrix information = Matrix::Zero();
    Vector gradient = Vector::Zero();
    double mean_square = 0;  ///< of the residuals
  };

  [[nodiscard]] Equations Linearise() const {
    Equations equations;
    for (const Pixel& p : pixels_) {
      const Eigen::Vector2d y = (Eigen::Vector2d(p.x, p.y) - centre_) / side_;
      const double light = 1 + state_.gradient.dot(y),
                   level = state_.level + state_.contrast * p.value;
      const double residual = gray_.at<unsigned char>(p.y, p.x) - light * level;
      Vector j;
      j.head<8>() = -light * state_.contrast * (p.slope.transpose() * p.motion).transpose();
      j.tail<5>() << light, light * p.value, level * y.x(), level * y.y(),
          light * state_.contrast * p.by_blur;
      equations.information += j * j.transpose();
      equations.gradient += j * residual;
      equations.mean_square += residual * residual / static_cast<double>(pixels_.size());
    }
    return equations;
  }

  /// To the minimum over the pixels chosen; returns the equations there.
  Equations Descend() {
    constexpr int kSteps = 40;
    constexpr double kNear = 0.01;
    Equations now = Linearise();
    double damping = 1e-3;
    for (int step = 0; step < kSteps && damping < 1; ++step) {
      Matrix damped = now.information;
      damped.diagonal() *= 1 + damping;
      const Vector change = damped.ldlt().solve(now.gradient);
      const double largest = change.head<8>().cwiseAbs().maxCoeff();
      // The square of the step in standard deviations; a tenth of one is near enough.
      const double square = change.dot(now.gradient) / now.mean_square;
      if (!change.allFinite() || square < kNear) break;
      // Never more than half a bit a step: farther off the drawing says nothing.
      const double limit = side_ / border_.width / 2;
      const double scale = largest > limit ? limit / largest : 1;
      const State before = state_;
      for (int k = 0; k < 4; ++k) state_.corners[k] += scale * change.segment<2>(2 * k);
      state_.level += change[8];
      state_.contrast += change[9];
      state_.gradient += change.segment<2>(10);
      state_.blur = std::clamp(state_.blur + scale * change[12], kLeastBlur, kMostBlur);
      std::vector<Pixel> drawn_before;
      drawn_before.swap(pixels_);
      const bool drawn = Draw(false);
      const Equations next = drawn ? Linearise() : now;
      if (drawn && next.mean_square < now.mean_square) {
        damping = std::max(damping / 10, 1e-7);
        const double gain = now.mean_square / next.mean_square - 1;
        now = next;
        if (gain * static_cast<double>(pixels_.size()) < kNear) break;
      } else {
        state_ = before;
        pixels_.swap(drawn_before);
        damping *= 10;
      }
    }
    return now;
  }

  void StartLevels() {
    Correlation all;
    for (const Pixel& p : pixels_) all.Add(p.value, gray_.at<unsigned char>(p.y, p.x));
    const double variance = all.n * all.xx - all.x * all.x;
    state_.contrast = variance > 0 ? (all.n * all.xy - all.x * all.y) / variance : 0;
    state_.level = (all.y - state_.contrast * all.x) / all.n;
  }

  const cv::Mat& gray_;
  TagBorder border_;
  State state_;
  std::vector<float> cells_;  ///< the tag and one bit around it, -1 or 1
  cv::Rect region_;
  Eigen::Matrix3d mask_;  ///< image to tag; says which pixels are compared
  cv::Mat fine_;
  std::vector<Pixel> pixels_;
  Eigen::Vector2d centre_;
  double side_ = 0;
  std::array<double, 4> sigma_{};
};

}  // namespace plenocal::internal
