// SPDX-License-Identifier: Apache-2.0
#include "apps/photometry/response_fit.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>

#include "apps/photometry/rising_values.h"
#include "calib/base/error.h"
#include "calib/base/parallel.h"
#include "calib/base/robust.h"
#include "calib/base/statistics.h"

namespace plenocal {
namespace {

constexpr size_t kGreys = ResponseCurve::kValues;
constexpr size_t kBorders = kGreys - 1;
constexpr double kFull = 255;
constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();
constexpr size_t kSets = 20;     // of pixels; the scatter's own error is 1 / sqrt(2 * 19) = 16 %
constexpr int kStartRounds = 6;  // with means in place of borders
constexpr int kRounds = 12;
constexpr double kBorderSigmas = 4;  // standard deviations

double NormalDensity(double x) { return std::exp(-x * x / 2) / std::sqrt(2 * std::numbers::pi); }
double NormalDistribution(double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); }

double SquareOf(double x) { return x * x; }

// How often each grey value was seen at each light. Bins are even in the light's square root, so
// that each is as wide, in standard deviations of shot noise, as any other.
struct LightHistogram {
  static constexpr size_t kBins = 2048;
  static constexpr double kMostLight = 1.3 * kFull;  // sensors are full below
  std::vector<std::uint32_t> count = std::vector<std::uint32_t>(kBins * kGreys);
  std::vector<double> pixels = std::vector<double>(kBins);    // of all grey values
  std::vector<double> light = std::vector<double>(kBins);     // sum
  std::vector<double> variance = std::vector<double>(kBins);  // sum, of the error of the light

  [[nodiscard]] static size_t BinOf(double u) {
    return static_cast<size_t>(std::sqrt(u / kMostLight) * kBins);
  }
  [[nodiscard]] static double LightOf(size_t bin) {
    return SquareOf((static_cast<double>(bin) + 0.5) / kBins) * kMostLight;
  }
  void Add(double u, double error_variance, std::uint8_t grey) {
    if (!(u >= 0 && u < kMostLight)) return;
    const size_t bin = BinOf(u);
    ++count[bin * kGreys + grey];
    pixels[bin] += 1;
    light[bin] += u;
    variance[bin] += error_variance;
  }
  // Means instead of sums, counts of this and all lower grey values instead of those of one.
  void Accumulate() {
    for (size_t b = 0; b < kBins; ++b) {
      if (pixels[b] == 0) continue;
      light[b] /= pixels[b];
      variance[b] /= pixels[b];
      std::uint32_t* row = &count[b * kGreys];
      std::partial_sum(row, row + kGreys, row);
    }
  }
};

// Fit of one set of pixels.
class SetFit {
 public:
  SetFit(const ExposureSweep& sweep, std::vector<size_t> pixels)
      : sweep_(sweep), pixels_(std::move(pixels)) {
    std::iota(values_.begin(), values_.end(), 0.0);
    SetBorders();
  }

  void Run() {
    light_.assign(pixels_.size(), kNaN);
    for (int round = 0; round < kStartRounds; ++round) {
      EstimateLight();
      SetValuesToMeans();
    }
    for (int round = 0; round < kRounds; ++round) {
      EstimateLight();
      // The noise of the start comes from the wrong curve, so that it finds no moving pixels.
      constexpr int kNoiseRounds = 7;
      if (round == kNoiseRounds) LeaveOutMoving();
      LightHistogram histogram = MakeHistogram();
      EstimateNoise(histogram);
      histogram.Accumulate();
      FitBorders(histogram);
    }
    EstimateLight();
  }

  [[nodiscard]] const ResponseCurve::Table& Values() const { return values_; }
  [[nodiscard]] const std::array<double, kBorders>& Information() const { return information_; }
  [[nodiscard]] const SensorNoise& Noise() const { return noise_; }
  [[nodiscard]] size_t Moving() const { return moving_; }
  [[nodiscard]] size_t Pixels() const {
    return static_cast<size_t>(std::ranges::count_if(light_, [](double E) { return E > 0; }));
  }

  // Relative differences of the images from their exposures: sums over pixels for each image.
  struct ImageSum {
    double weighted = 0, weight = 0;
    std::array<double, kGreys> count{};
    double squares = 0, number = 0;  // of U(I) - t E
  };
  void AddImageSums(std::vector<ImageSum>* sums) const {
    for (size_t j = 0; j < pixels_.size(); ++j) {
      if (!(light_[j] > 0)) continue;
      for (size_t i = 0; i < sweep_.exposures.size(); ++i) {
        ImageSum& sum = (*sums)[i];
        const std::uint8_t grey = sweep_.grey[i][pixels_[j]];
        sum.count[grey] += 1;
        const double u = sweep_.exposures[i] * light_[j];
        if (!IsUsed(i, j, u)) continue;
        const double residual = middles_[grey] - u, variance = VarianceAt(u);
        sum.weighted += residual * u / variance;
        sum.weight += u * u / variance;
        sum.squares += residual * residual;
        sum.number += 1;
      }
    }
  }

 private:
  // After a change of borders or noise: what depends on them.
  void Tabulate() {
    middles_ = values_;
    for (size_t k = 1; k + 1 < kGreys; ++k) middles_[k] = (borders_[k - 1] + borders_[k]) / 2;
    for (size_t b = 0; b < LightHistogram::kBins; ++b) {
      variances_[b] = Variance(LightHistogram::LightOf(b));
    }
    constexpr size_t kLastBorder = kBorders - 1;
    brightest_ = borders_[kLastBorder] - kBorderSigmas * std::sqrt(Variance(borders_[kLastBorder]));
    darkest_ = 0;
    for (size_t b = 0; b < LightHistogram::kBins; ++b) {
      const double u = LightHistogram::LightOf(b);
      if (u < kBorderSigmas * std::sqrt(variances_[b])) darkest_ = u;
    }
  }
  void SetBorders() {
    for (size_t k = 0; k < kBorders; ++k) borders_[k] = (values_[k] + values_[k + 1]) / 2;
    Tabulate();
  }
  // Of the light of one pixel by its grey value.
  [[nodiscard]] double Variance(double u) const {
    const auto value = std::ranges::upper_bound(values_, u);
    const auto k = std::clamp<size_t>(static_cast<size_t>(value - values_.begin()), 1, kGreys - 1);
    const double step = values_[k] - values_[k - 1];
    return std::max(noise_.gain * u + SquareOf(noise_.read) + step * step / 12, 1e-12);
  }
  [[nodiscard]] double VarianceAt(double u) const {
    return variances_[LightHistogram::BinOf(std::clamp(u, 0.0, kFull))];
  }
  // Chosen by the light, not by the grey value, whose noise would choose. In the dark, grey value 0
  // cuts the noise off.
  [[nodiscard]] bool IsUsed(size_t image, size_t j, double u) const {
    return u < brightest_ && u > darkest_ && !sweep_.beside_saturated[image][pixels_[j]];
  }

  void EstimateLight() {
    for (size_t j = 0; j < pixels_.size(); ++j) {
      const bool first = std::isnan(light_[j]);
      if (!first && !(light_[j] > 0)) continue;  // left out
      double sum = 0, weight = 0;
      for (size_t i = 0; i < sweep_.exposures.size(); ++i) {
        const double t = sweep_.exposures[i];
        const std::uint8_t grey = sweep_.grey[i][pixels_[j]];
        const double u = first ? middles_[grey] : t * light_[j];
        if (!IsUsed(i, j, u)) continue;
        const double w = 1 / VarianceAt(u);
        sum += w * t * middles_[grey];
        weight += w * t * t;
      }
      light_[j] = weight > 0 ? sum / weight : 0;
    }
  }

  void SetValuesToMeans() {
    std::array<double, kGreys> sum{}, count{};
    for (size_t j = 0; j < pixels_.size(); ++j) {
      if (!(light_[j] > 0)) continue;
      for (size_t i = 0; i < sweep_.exposures.size(); ++i) {
        const double u = sweep_.exposures[i] * light_[j];
        const std::uint8_t grey = sweep_.grey[i][pixels_[j]];
        if (grey == kGreys - 1 || sweep_.beside_saturated[i][pixels_[j]]) continue;
        sum[grey] += u;
        count[grey] += 1;
      }
    }
    for (size_t k = 0; k < kGreys; ++k) values_[k] = count[k] > 0 ? sum[k] / count[k] : kNaN;
    Complete();
    MakeRising(values_, count);
    SetBorders();
  }

  // Fills values that were not seen and scales all; returns the factor. Noise may have exchanged
  // dark values: only the mean of all sets is made to rise, or it would be too bright.
  double Complete() {
    values_[0] = 0;
    FillGaps(values_);
    const double scale = kFull / values_[kGreys - 1];
    for (double& value : values_) value *= scale;
    return scale;
  }

  [[nodiscard]] LightHistogram MakeHistogram() const {
    LightHistogram histogram;
    std::vector<double> weights(sweep_.exposures.size());
    for (size_t j = 0; j < pixels_.size(); ++j) {
      if (!(light_[j] > 0)) continue;
      double sum = 0, weight = 0;
      for (size_t i = 0; i < weights.size(); ++i) {
        const double t = sweep_.exposures[i], u = t * light_[j];
        weights[i] = IsUsed(i, j, u) ? 1 / VarianceAt(u) : 0;
        sum += weights[i] * t * middles_[sweep_.grey[i][pixels_[j]]];
        weight += weights[i] * t * t;
      }
      for (size_t i = 0; i < weights.size(); ++i) {
        if (sweep_.beside_saturated[i][pixels_[j]]) continue;
        // The light as all other images have it: its error is independent of this one's.
        const double t = sweep_.exposures[i];
        const std::uint8_t grey = sweep_.grey[i][pixels_[j]];
        const double others = weight - weights[i] * t * t;
        if (!(others > weight * 1e-9)) continue;
        const double u = t * (sum - weights[i] * t * middles_[grey]) / others;
        histogram.Add(u, t * t / others, grey);
      }
    }
    return histogram;
  }

  // Straight line of the variance of U(I) over the light.
  void EstimateNoise(const LightHistogram& histogram) {
    double n00 = 0, n01 = 0, n11 = 0, b0 = 0, b1 = 0;
    for (size_t b = 0; b < LightHistogram::kBins; ++b) {
      const double n = histogram.pixels[b];
      constexpr double kFewest = 30;
      if (n < kFewest) continue;
      const double u = histogram.light[b] / n;
      const double assumed = VarianceAt(u);
      if (u > brightest_ || u < darkest_) continue;
      double mean = 0, square = 0;
      for (size_t k = 0; k < kGreys; ++k) {
        const double count = histogram.count[b * kGreys + k];
        mean += count * middles_[k];
        square += count * middles_[k] * middles_[k];
      }
      mean /= n;
      const double rounding = assumed - noise_.gain * u - SquareOf(noise_.read);
      const double width = 2 * std::sqrt(u * LightHistogram::kMostLight) / LightHistogram::kBins;
      const double variance =
          square / n - mean * mean - rounding - histogram.variance[b] / n - width * width / 12;
      const double w = n / SquareOf(assumed);
      n00 += w * u * u;
      n01 += w * u;
      n11 += w;
      b0 += w * u * variance;
      b1 += w * variance;
    }
    const double determinant = n00 * n11 - n01 * n01;
    if (!(determinant > 0)) return;
    const double gain = (n11 * b0 - n01 * b1) / determinant;
    const double read = (n00 * b1 - n01 * b0) / determinant;
    // One of the two alone where the other comes out negative.
    noise_.gain = read > 0 ? std::max(gain, 0.0) : std::max(b0 / n00, 0.0);
    noise_.read = gain > 0 ? std::sqrt(std::max(read, 0.0)) : std::sqrt(std::max(b1 / n11, 0.0));
  }

  // Pixels whose residuals are larger than noise: the scene moved there.
  void LeaveOutMoving() {
    constexpr double kOneIn = 1e-4;
    for (size_t j = 0; j < pixels_.size(); ++j) {
      if (!(light_[j] > 0)) continue;
      double chi_square = 0;
      int number = 0;
      for (size_t i = 0; i < sweep_.exposures.size(); ++i) {
        const double u = sweep_.exposures[i] * light_[j];
        if (!IsUsed(i, j, u)) continue;
        chi_square += SquareOf(middles_[sweep_.grey[i][pixels_[j]]] - u) / VarianceAt(u);
        ++number;
      }
      // Twice: exposures have errors of their own.
      if (number > 1 && ChiSquareTail(number - 1, chi_square / 2) < kOneIn) {
        light_[j] = 0;
        ++moving_;
      }
    }
  }

  void FitBorders(const LightHistogram& histogram) {
    for (size_t k = 0; k < kBorders; ++k) FitBorder(histogram, k);
    ResponseCurve::Table values;
    values.fill(kNaN);
    for (size_t k = 1; k + 1 < kGreys; ++k) {
      if (information_[k - 1] == 0 || information_[k] == 0) continue;
      values[k] = (borders_[k - 1] + borders_[k]) / 2;
      const bool cubic =
          k >= 2 && k + 2 < kGreys && information_[k - 2] > 0 && information_[k + 1] > 0;
      if (cubic) {
        values[k] = (9 * (borders_[k - 1] + borders_[k]) - borders_[k - 2] - borders_[k + 1]) / 16;
      }
    }
    values_ = values;
    // Borders are scaled as the values; those not seen are between the values.
    const double scale = Complete();
    for (size_t k = 0; k < kBorders; ++k) {
      borders_[k] = information_[k] > 0 ? borders_[k] * scale : (values_[k] + values_[k + 1]) / 2;
    }
    Tabulate();
  }

  // Root of sum phi(x) (lower - n Phi(x)). Beside likelihood's equation it lacks 1 / (Phi (1 -
  // Phi)), which gives the weight to far tails, where a small error of sigma decides. `information`
  // is 0 where too few pixels are near the border.
  void FitBorder(const LightHistogram& histogram, size_t k) {
    constexpr int kSteps = 3;
    double& border = borders_[k];
    for (int step = 0; step < kSteps; ++step) {
      const double reach = (kBorderSigmas + 1) * std::sqrt(VarianceAt(border));
      double slope = 0, information = 0, below = 0, above = 0;
      const double low = std::sqrt(std::max(border - reach, 0.0) / LightHistogram::kMostLight);
      const double high = std::sqrt((border + reach) / LightHistogram::kMostLight);
      const auto last =
          std::min(LightHistogram::kBins - 1, static_cast<size_t>(high * LightHistogram::kBins));
      for (auto b = static_cast<size_t>(low * LightHistogram::kBins); b <= last; ++b) {
        const double n = histogram.pixels[b];
        if (n == 0) continue;
        const double u = histogram.light[b];
        // Rounding is what the borders describe.
        const double sigma = std::sqrt(
            std::max(noise_.gain * u + SquareOf(noise_.read) + histogram.variance[b], 1e-12));
        const double x = (border - u) / sigma;
        const double density = NormalDensity(x);
        const double lower = histogram.count[b * kGreys + k];
        slope += (lower - n * NormalDistribution(x)) * density;
        information += n * density * density / sigma;
        below += lower;
        above += n - lower;
      }
      constexpr double kFewest = 20;
      if (!(information > 0) || below < kFewest || above < kFewest) {
        information_[k] = 0;
        return;
      }
      information_[k] = information;
      border = std::clamp(border + slope / information, border - reach, border + reach);
    }
  }

  const ExposureSweep& sweep_;
  std::vector<size_t> pixels_;
  std::vector<double> light_;  // E by pixel; NaN: not yet known, 0: not used
  ResponseCurve::Table values_;
  std::array<double, kBorders> borders_{}, information_{};
  SensorNoise noise_{.gain = kFull / 1e4, .read = 0.5};  // as most sensors; estimated soon
  // Tables of the curve: mean light of a grey value, variance by bin of the histogram.
  ResponseCurve::Table middles_;
  std::array<double, LightHistogram::kBins> variances_{};
  double brightest_ = kFull, darkest_ = 0;  // light of usable pixels
  size_t moving_ = 0;
};

void CheckSweep(const ExposureSweep& sweep, const std::string& where) {
  const auto [least, largest] = std::ranges::minmax(sweep.exposures);
  constexpr double kLeastRatio = 2;
  if (!(largest >= kLeastRatio * least)) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: exposures are from {:.4g} to {:.4g} ms; a response needs a static "
                            "scene at exposures that differ by a factor of 10 or more",
                            where,
                            least,
                            largest));
  }
  size_t saturated = 0, black = 0, all = 0;
  for (const auto& image : sweep.grey) {
    for (const std::uint8_t grey : image) {
      saturated += grey == kGreys - 1 ? 1U : 0U;
      black += grey == 0 ? 1U : 0U;
    }
    all += image.size();
  }
  constexpr double kMost = 0.95;
  if (static_cast<double>(saturated) > kMost * static_cast<double>(all)) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: {:.0f} % of the pixels are saturated; use shorter exposures or "
                            "less light",
                            where,
                            100.0 * static_cast<double>(saturated) / static_cast<double>(all)));
  }
  if (static_cast<double>(black) > kMost * static_cast<double>(all)) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: {:.0f} % of the pixels are black; use longer exposures or more "
                            "light",
                            where,
                            100.0 * static_cast<double>(black) / static_cast<double>(all)));
  }
}

// Mean of the sets' values and its standard deviation, both up to one factor.
void Combine(const std::vector<SetFit>& sets,
             ResponseCurve::Table* mean,
             ResponseEstimate* result) {
  const auto count = static_cast<double>(sets.size());
  mean->fill(0);
  for (const SetFit& set : sets) {
    for (size_t k = 0; k < kGreys; ++k) (*mean)[k] += set.Values()[k] / count;
  }
  std::array<double, kGreys> variance{};
  for (const SetFit& set : sets) {
    double scale = 0, norm = 0;
    for (size_t k = 0; k < kGreys; ++k) {
      scale += set.Values()[k] * (*mean)[k];
      norm += SquareOf(set.Values()[k]);
    }
    scale /= norm;
    for (size_t k = 0; k < kGreys; ++k) {
      variance[k] += SquareOf(scale * set.Values()[k] - (*mean)[k]) / (count * (count - 1));
    }
  }
  // Neighbouring values have nearly the same standard deviation; one of 20 sets is uncertain.
  constexpr std::ptrdiff_t kReach = 4;
  for (std::ptrdiff_t k = 0; k < static_cast<std::ptrdiff_t>(kGreys); ++k) {
    double sum = 0, number = 0;
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(k - kReach, 1);
         i <= std::min<std::ptrdiff_t>(k + kReach, kGreys - 2);
         ++i) {
      sum += variance[static_cast<size_t>(i)];
      number += 1;
    }
    result->sigma[static_cast<size_t>(k)] = std::sqrt(sum / number);
  }
}

void AddExposureErrors(const std::vector<SetFit>& sets,
                       const ResponseCurve::Table& values,
                       ResponseEstimate* result) {
  std::vector<SetFit::ImageSum> sums(result->exposure_errors.size());
  for (const SetFit& set : sets) set.AddImageSums(&sums);
  double squares = 0, number = 0, excess = 0;
  size_t images = 0;
  for (size_t i = 0; i < sums.size(); ++i) {
    squares += sums[i].squares;
    number += sums[i].number;
    if (!(sums[i].weight > 0)) continue;
    const double error = sums[i].weighted / sums[i].weight;
    result->exposure_errors[i] = error;
    excess += error * error - 1 / sums[i].weight;
    ++images;
  }
  result->rms = std::sqrt(squares / number);
  if (images > 0) {
    result->exposure_sigma = std::sqrt(std::max(excess / static_cast<double>(images), 0.0));
  }
  for (size_t k = 0; k < kGreys; ++k) {
    double sum = 0, sum_of_squares = 0;
    for (const SetFit::ImageSum& image : sums) {
      sum += image.count[k];
      sum_of_squares += SquareOf(image.count[k]);
    }
    result->count[k] = static_cast<size_t>(sum);
    if (sum == 0) continue;
    // Images share their error among all of their pixels.
    const double variance =
        SquareOf(values[k] * result->exposure_sigma) * sum_of_squares / (sum * sum);
    result->sigma[k] = std::sqrt(SquareOf(result->sigma[k]) + variance);
  }
}

}  // namespace

ResponseEstimate FitResponse(const ExposureSweep& sweep, const std::string& where, int threads) {
  CheckSweep(sweep, where);
  std::vector<SetFit> sets;
  const size_t pixels = sweep.grey[0].size();
  for (size_t s = 0; s < kSets; ++s) {
    std::vector<size_t> members;
    for (size_t x = s; x < pixels; x += kSets) members.push_back(x);
    sets.emplace_back(sweep, std::move(members));
  }
  ParallelFor(kSets, threads, [&](size_t s) { sets[s].Run(); });

  ResponseEstimate result;
  result.exposure_errors.assign(sweep.exposures.size(), 0);
  std::array<double, kBorders> information{};
  for (const SetFit& set : sets) {
    result.pixels += set.Pixels();
    result.moving += set.Moving();
    result.noise.gain += set.Noise().gain / kSets;
    result.noise.read += set.Noise().read / kSets;
    for (size_t k = 0; k < kBorders; ++k) information[k] += set.Information()[k];
  }
  if (result.moving > result.pixels) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: in most pixels the light is not proportional to the exposure; the "
                            "camera and the scene must stand still, the gain must be fixed and the "
                            "lamp must not flicker",
                            where));
  }
  const auto is_known = [](double value) { return value > 0; };
  const auto first = std::ranges::find_if(information, is_known);
  const auto known = std::ranges::count_if(information, is_known);
  constexpr std::ptrdiff_t kFewestBorders = 20;
  if (known < kFewestBorders) {
    throw Error(ErrorKind::kJob,
                fmt::format("{}: only {} of 255 borders between grey values were seen; use a scene "
                            "with dark and bright parts and more exposures between them",
                            where,
                            known));
  }
  result.first = static_cast<int>(first - information.begin());
  for (size_t k = 0; k < kBorders; ++k) {
    if (is_known(information[k])) result.last = static_cast<int>(k) + 1;
  }
  ResponseCurve::Table values;
  Combine(sets, &values, &result);
  AddExposureErrors(sets, values, &result);
  // Light is not negative, and response files have none at grey value 0.
  std::array<double, kGreys> weights{};
  for (size_t k = 0; k < kGreys; ++k) {
    values[k] = std::max(values[k], 0.0);
    weights[k] = k == 0 ? 1e12 : static_cast<double>(result.count[k]);
  }
  MakeRising(values, weights);
  for (size_t k = 0; k < kGreys; ++k) {
    const bool seen =
        k > 0 && k < kBorders && is_known(information[k - 1]) && is_known(information[k]);
    if (!seen) result.sigma[k] = kNaN;
  }
  result.curve = ResponseCurve(values);
  return result;
}

}  // namespace plenocal
