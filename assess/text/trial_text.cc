// SPDX-License-Identifier: Apache-2.0
#include "assess/text/trial_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "calib/base/number_text.h"
#include "calib/files/session.h"

namespace plenocal {
namespace {

std::string WhyNotComparable(const ModelTrial& trial) {
  if (!trial.failure.empty()) return trial.failure;
  if (trial.comparable) return {};
  return fmt::format("does not image {:.1f} % of the held-out points", 100 * trial.unseen);
}

std::string JudgementText(const ModelChoice& choice, size_t m) {
  const ModelTrial& trial = choice.trials[m];
  if (m == choice.recommended) return "recommended";
  if (!trial.comparable) return {};
  if (trial.outweighed_by) {
    const std::string_view simpler = choice.trials[*trial.outweighed_by].model->name;
    if (!trial.undetermined.empty()) {
      return fmt::format(
          "leaves parameters open for a gain of {:.2g} px over {}", trial.gain, simpler);
    }
    if (!(trial.gain > 0)) return fmt::format("sigma grows without a gain over {}", simpler);
    return fmt::format(
        "sigma grows by more than its gain of {:.2g} px over {}", trial.gain, simpler);
  }
  if (m == choice.reference) return "best";
  if (trial.practically_equal) return "practically equal to the best";
  return trial.probability < kSignificant ? "worse than the best" : "not distinguishable";
}

TrialRow MakeRow(const ModelChoice& choice, size_t m) {
  const ModelTrial& trial = choice.trials[m];
  return {.trial = &trial,
          .recommended = m == choice.recommended,
          .judgement = JudgementText(choice, m),
          .why_not = WhyNotComparable(trial)};
}

std::string DifferenceText(double difference) {
  return std::isfinite(difference) ? fmt::format("projections differ by {:.4f} px", difference)
                                   : "projections have no pixel in common";
}

// The difference of the recommended from the reference, beside what it is compared with.
std::string DifferenceText(const ModelChoice& choice) {
  const double sigma = choice.trials[choice.reference].sigma;
  return fmt::format("{}; the noise is {:.4f} px, the projection's sigma {}",
                     DifferenceText(choice.trials[choice.recommended].difference),
                     choice.noise,
                     std::isfinite(sigma) ? fmt::format("{:.4f} px", sigma) : "not determined");
}

// Why the reference is recommended.
std::string ReasonOfReference(const ModelChoice& choice) {
  const ModelTrial& recommended = choice.trials[choice.recommended];
  bool any_simpler = false, any_good = false;
  for (const ModelTrial& trial : choice.trials) {
    if (!trial.comparable || trial.free_parameters >= recommended.free_parameters) continue;
    any_simpler = true;
    any_good |= trial.practically_equal || trial.probability >= kSignificant;
  }
  return fmt::format(
      "{}; {}",
      choice.reference == 0 ? "the best" : "the best whose gain is larger than its uncertainty",
      !any_simpler ? "none is simpler"
      : any_good   ? "simpler ones predict worse, or are less common"
                   : "every simpler model is significantly worse");
}

std::string Reason(const ModelChoice& choice) {
  const ModelTrial& recommended = choice.trials[choice.recommended];
  if (choice.trials.size() == 1) return "the only model tried";
  if (std::ranges::count(choice.trials, true, &ModelTrial::comparable) == 1) {
    return "the only model that images what the camera sees";
  }
  if (choice.recommended == choice.reference) return ReasonOfReference(choice);
  const bool is_usual = recommended.model->name == kUsualModel;
  return fmt::format(
      "{} that is {} the best, {} ({})",
      is_usual                                     ? "OpenCV's five coefficients, a model"
      : recommended.model->usage == Usage::kCommon ? "the simplest common model"
                                                   : "the simplest model",
      recommended.practically_equal ? "practically equal to" : "not significantly worse than",
      choice.trials[choice.reference].model->name,
      DifferenceText(choice));
}

std::string HeldOutText(const ModelTrial& trial) {
  return fmt::format("{:.4f} +- {:.4f}", trial.rms, trial.rms_sigma);
}

std::string PixelText(double value) {
  constexpr double kMost = 1000;  // more is no image of this camera
  return value < kMost ? fmt::format("{:.4f}", value) : std::isinf(value) ? "inf" : "> 1000";
}

std::string QuotedField(const std::string& text) {
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

}  // namespace

std::vector<TrialRow> MakeRows(const ModelChoice& choice) {
  std::vector<TrialRow> rows;
  for (size_t m = 0; m < choice.trials.size(); ++m) rows.push_back(MakeRow(choice, m));
  return rows;
}

std::string ModelRecommendation(const ModelChoice& choice) {
  constexpr size_t kFew = 10;  // frames: tests over fewer find little
  const ModelTrial& recommended = choice.trials[choice.recommended];
  return fmt::format("{}, {}{}; {}, {:.4f} +- {:.4f} px on frames that it has not seen",
                     recommended.model->name,
                     Reason(choice),
                     choice.frames < kFew ? "; but so few frames can hardly tell models apart" : "",
                     Counted(static_cast<size_t>(recommended.free_parameters), "parameter"),
                     recommended.rms,
                     recommended.rms_sigma);
}

std::string ConfidenceText(const ModelChoice& choice) {
  if (std::ranges::count(choice.trials, true, &ModelTrial::comparable) < 2) return "";
  std::vector<std::string_view> names;
  for (const size_t m : choice.confidence_set) names.push_back(choice.trials[m].model->name);
  return fmt::format("With 90 % the best model {}{}.\n",
                     names.size() == 1 ? "is " : "is one of: ",
                     fmt::join(names, ", "));
}

// "held" or "refined", as in session and try.yaml.
std::string_view TargetName(const ModelTrial& trial) {
  return trial.marker_freedom.IsRigid() ? "held" : "refined";
}

std::string TargetRecommendation(const ModelChoice& targets, MarkerFreedom of_session) {
  const ModelTrial& recommended = targets.trials[targets.recommended];
  const auto other = std::ranges::find_if(targets.trials, [&](const ModelTrial& trial) {
    return TargetName(trial) != TargetName(recommended);
  });
  if (!other->failure.empty() || !other->comparable) {
    return fmt::format("{}; {}, it cannot be judged", TargetName(recommended), TargetName(*other));
  }
  // One of them is the reference, which is equal to itself.
  const bool equal = recommended.practically_equal && other->practically_equal;
  const std::string_view reason =
      !recommended.marker_freedom.IsRigid() ? "held rigid it predicts held-out frames worse"
      : other->outweighed_by                ? "to refine it gains less than it costs in uncertainty"
      : equal                               ? "to refine it makes practically no difference"
                                            : "refined it predicts held-out frames no better";
  const bool refined = !recommended.marker_freedom.IsRigid();
  const std::string remedy =
      refined != of_session.IsRigid()
          ? ""
          : fmt::format("; state refine_target: {} in the session's options", refined);
  return fmt::format("{}, {} ({:.4f} +- {:.4f} px, {} {:.4f} +- {:.4f} px; {}){}",
                     TargetName(recommended),
                     reason,
                     recommended.rms,
                     recommended.rms_sigma,
                     TargetName(*other),
                     other->rms,
                     other->rms_sigma,
                     DifferenceText(std::max(recommended.difference, other->difference)),
                     remedy);
}

// The tables on standard output.
std::string TrialTable(const ModelChoice& choice, const std::vector<TrialRow>& rows) {
  std::string text =
      fmt::format("{}, {}; {} count, {}\n\n  {:<18} {:>10} {:>19} {:>12} {:>8} {:>14} {:>7}  {}\n",
                  Counted(choice.frames, "frame"),
                  Counted(choice.folds, "fold"),
                  Counted(choice.points, "point"),
                  Counted(choice.outliers, "outlier"),
                  "model",
                  "parameters",
                  "held-out RMS px",
                  "from best px",
                  "sigma px",
                  "90 % image px",
                  "s",
                  "judgement");
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    if (!row.why_not.empty()) {
      text += fmt::format("  {:<18} {}\n", trial.model->name, row.why_not);
      continue;
    }
    text += fmt::format("{} {:<18} {:>10} {:>19} {:>12} {:>8} {:>14} {:>7.2f}  {}\n",
                        row.recommended ? "*" : " ",
                        trial.model->name,
                        trial.free_parameters,
                        HeldOutText(trial),
                        PixelText(trial.difference),
                        PixelText(trial.sigma),
                        PixelText(trial.projection),
                        trial.seconds,
                        row.judgement);
    if (trial.undetermined.empty()) continue;
    text += fmt::format("    not determined: {}\n", fmt::join(trial.undetermined, " "));
  }
  return text;
}

std::string StressText(const std::vector<StressTest>& stress) {
  if (stress.empty()) return "";
  std::string text = fmt::format("\n  {:<12} {:<14} {:>8} {:>14} {:>13} {:>8}\n",
                                 "stress",
                                 "of",
                                 "p",
                                 "difference px",
                                 "predicted px",
                                 "factor");
  for (const StressTest& test : stress) {
    text += fmt::format("{} {:<12} {:<14} ", test.Fails() ? "*" : " ", test.what, test.camera);
    text += test.failure.empty() ? fmt::format("{:>8.2g} {:>14.4f} {:>13.4f} {:>8.2f}\n",
                                               test.probability,
                                               test.difference,
                                               test.predicted,
                                               test.factor)
                                 : test.failure + "\n";
  }
  return text + StressReading(stress);
}

std::string TrialCsv(const std::vector<TrialRow>& rows) {
  std::string text =
      "model,parameters,held_out_rms,held_out_sigma,probability,difference,sigma,in_sample_rms,image_sigma,unseen,recommended,judgement,undetermined,failure\n";
  for (const TrialRow& row : rows) {
    const ModelTrial& trial = *row.trial;
    if (!trial.failure.empty()) {
      text += fmt::format("{},,,,,,,,,,0,,,{}\n", trial.model->name, QuotedField(trial.failure));
      continue;
    }
    text += fmt::format("{},{},{},{:.6g},{},{:.6g},{},{},{},\n",
                        trial.model->name,
                        trial.free_parameters,
                        trial.comparable ? fmt::format("{:.6g},{:.3g},{:.3g},{:.3g},{:.3g}",
                                                       trial.rms,
                                                       trial.rms_sigma,
                                                       trial.probability,
                                                       trial.difference,
                                                       trial.sigma)
                                         : ",,,,",
                        trial.in_sample_rms,
                        trial.comparable ? fmt::format("{:.6g}", trial.image_sigma) : "",
                        trial.unseen,
                        row.recommended ? 1 : 0,
                        QuotedField(row.judgement),
                        fmt::join(trial.undetermined, " "));
  }
  return text;
}

}  // namespace plenocal
