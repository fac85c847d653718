// SPDX-License-Identifier: Apache-2.0
//
// Limits, values and texts of the causes in a recording, on points whose residuals are stated.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "assess/causes/cause.h"
#include "calib/base/linear_algebra.h"
#include "calib/base/statistics.h"
#include "models/registry.h"

namespace plenocal {

Cause DuplicateImagesCause();
Cause FocusChangedCause();
Cause FrameOutlierCause();
Cause ImagesRotatedCause();
Cause MarkerOutlierCause();
Cause OrientationTagCause();
Cause PointsAtBorderCause();
Cause RigMotionCause();
Cause RollingShutterCause();
Cause WorseImagesCause();

namespace testing {
namespace TEST_FILE {

using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr double kSigma = 0.1;  // px
constexpr double kFocal = 1000;
const Eigen::Vector2d kMiddle(639.5, 479.5);

using ResidualOf = std::function<Eigen::Vector2d(const BundleObservation&)>;

/// Cameras of one place that see 10 x 7 markers, 30 mm apart, in all frames; points without errors.
struct Exact {
  explicit Exact(int frames, int cameras = 1) {
    Bundle& bundle = calibration.bundle;
    for (int c = 0; c < cameras; ++c) {
      bundle.cameras.push_back({.name = "cam" + std::to_string(c),
                                .image_size = {1280, 960},
                                .model = FindModel(CameraModels(), "pinhole"),
                                .config = {},
                                .params = {kFocal, kFocal, kMiddle.x(), kMiddle.y()},
                                .fixed = std::vector<bool>(4, false),
                                .T_camera_rig = {},
                                .is_master = c == 0});
    }
    for (int i = 0; i < 70; ++i) {
      const Eigen::Vector3d p(0.03 * (i % 10) - 0.135, 0.03 * (i / 10) - 0.09, 0);
      bundle.markers.push_back({.number = 100 + i, .position = p, .nominal = p});
    }
    for (int f = 0; f < frames; ++f) {
      calibration.frames.push_back("f" + std::to_string(f));
      bundle.T_rig_target.push_back(
          {ExpRotation({0.4 * std::cos(f), 0.4 * std::sin(f), 0.05 * f * (f % 3)}),
           {0.02 * std::sin(3 * f), 0.03 * std::cos(2 * f), 1 + 0.1 * std::sin(f)}});
    }
    calibration.fits.resize(static_cast<size_t>(cameras));
    for (CameraFit& fit : calibration.fits) fit.rms = fit.noise_sigma = kSigma;
    Observe();
  }

  void Observe() {
    Bundle& bundle = calibration.bundle;
    bundle.observations.clear();
    for (size_t f = 0; f < bundle.T_rig_target.size(); ++f) {
      for (size_t c = 0; c < bundle.cameras.size(); ++c) {
        for (size_t m = 0; m < bundle.markers.size(); ++m) {
          BundleObservation seen{.camera = static_cast<int>(c),
                                 .frame = static_cast<int>(f),
                                 .marker = static_cast<int>(m),
                                 .seen = {},
                                 .assumed_sigma = kSigma};
          const Eigen::Vector3d p = bundle.SeenPose(f, c) * bundle.markers[m].position;
          const Eigen::Vector2d image = kFocal * p.head<2>() / p.z() + kMiddle;
          seen.seen.values[0] = image.x(), seen.seen.values[1] = image.y();
          bundle.observations.push_back(seen);
        }
      }
    }
  }

  void Displace(const ResidualOf& residual) {
    for (BundleObservation& seen : calibration.bundle.observations) {
      const Eigen::Vector2d moved = residual(seen);
      seen.seen.values[0] += moved.x(), seen.seen.values[1] += moved.y();
    }
  }
  // Residuals of one length, larger in some frames.
  void SetLengths(const std::function<double(int frame)>& factor) {
    Displace([&](const BundleObservation& seen) {
      return Eigen::Vector2d(factor(seen.frame) * Eigen::Vector2d(0.06, -0.08));
    });
  }

  // Takes off what the poses of the frames explain of the residuals. Of one camera.
  void FitPoses() {
    const std::vector<ViewRows> views = RowsOfViews(calibration.bundle, 0);
    auto seen = calibration.bundle.observations.begin();
    for (const ViewRows& view : views) {
      const Eigen::VectorXd by_pose = view.pose * LeastSquares(view.pose, view.residual);
      for (Eigen::Index i = 0; i < view.noise.size(); ++i, ++seen) {
        seen->seen.values[0] -= kSigma * by_pose[2 * i];
        seen->seen.values[1] -= kSigma * by_pose[2 * i + 1];
      }
    }
  }

  [[nodiscard]] std::vector<Finding> Find(const Cause& cause, size_t camera = 0) const {
    CauseEvidence evidence{.calibration = &calibration, .camera = camera, .traits = &traits};
    if (cause.stage == CauseStage::kMotion) {
      evidence.views = RowsOfViews(calibration.bundle, camera);
    }
    return cause.find(evidence);
  }

  Calibration calibration;
  CameraTraits traits;
};

void ExpectFinding(const std::vector<Finding>& found, const Finding& expected, double near = 1e-6) {
  ASSERT_EQ(found.size(), 1);
  EXPECT_EQ(found[0].code, expected.code);
  EXPECT_EQ(found[0].role, expected.role);
  EXPECT_EQ(found[0].follows_from_noise, expected.follows_from_noise);
  EXPECT_EQ(found[0].grade, expected.grade);
  EXPECT_THAT(found[0].cameras, ::testing::ElementsAreArray(expected.cameras));
  EXPECT_NEAR(found[0].value.value(), expected.value.value(), near);
  EXPECT_NEAR(found[0].limit.value(), expected.limit.value(), near);
  EXPECT_EQ(found[0].what, expected.what);
}

TEST(FrameOutlierCauses, BeginAtThreeTimesTheTypicalFrame) {
  const auto find = [](int frames, int outliers, double factor) {
    Exact exact(frames);
    exact.SetLengths([&](int f) { return f >= 2 && f < 2 + outliers ? factor : 1; });
    return exact.Find(FrameOutlierCause());
  };
  EXPECT_THAT(find(12, 1, 2.99), IsEmpty());
  EXPECT_THAT(find(5, 1, 9), IsEmpty());
  EXPECT_EQ(find(6, 1, 9).size(), 1);
  EXPECT_THAT(find(12, 4, 9), IsEmpty());  // more than a quarter
  Finding expected{.code = "frame_outlier",
                   .role = FindingRole::kOutlier,
                   .follows_from_noise = true,
                   .grade = Grade::kUsable,
                   .value = 3.01,
                   .limit = 3,
                   .what =
                       "one frame disagrees with all others: f2 (residuals 3.0 times the "
                       "typical frame's)."};
  ExpectFinding(find(12, 1, 3.01), expected);
  expected.value = 9;
  expected.what =
      "some frames disagree with all others: f2, f3, f4 (residuals 9.0 times the typical frame's).";
  ExpectFinding(find(12, 3, 9), expected);
  EXPECT_THAT(find(12, 1, 0.01), IsEmpty());
}

TEST(FrameOutlierCauses, AreBeyondSixSigmasOfTheFramesScatter) {
  constexpr double kScatter = 0.2;
  const double limit = std::exp(6 * 1.4826 * kScatter);  // 5.9
  for (const double factor : {0.99 * limit, 1.01 * limit}) {
    Exact exact(13);
    exact.SetLengths([&](int f) {
      return f == 6 ? factor : f == 0 ? 1 : std::exp(f % 2 == 0 ? kScatter : -kScatter);
    });
    const std::vector<Finding> found = exact.Find(FrameOutlierCause());
    ASSERT_EQ(found.size(), factor > limit ? 1 : 0);
    if (found.empty()) continue;
    EXPECT_NEAR(*found[0].limit, limit, 1e-2 * limit);
  }
}

TEST(FrameOutlierCauses, CountResidualsInSigmas) {
  Exact exact(12);
  exact.SetLengths([](int f) { return f == 3 ? 20 : 1; });
  for (BundleObservation& seen : exact.calibration.bundle.observations) {
    if (seen.frame == 3) seen.assumed_sigma = 20 * kSigma;
  }
  EXPECT_THAT(exact.Find(FrameOutlierCause()), IsEmpty());
}

// The first `of` points of the first `markers` markers, `rejected` of them not used. Of all others
// every `other`th is not used.
std::vector<Finding> FindRejected(int markers, int rejected, int of, int other = 0) {
  Exact exact(40, 2);
  auto& observations = exact.calibration.bundle.observations;
  std::erase_if(observations,
                [&](const auto& seen) { return seen.marker < markers && seen.frame >= of; });
  int count = 0;
  for (BundleObservation& seen : observations) {
    if (seen.camera == 1) {
      seen.used = seen.marker != 69;
    } else if (seen.marker < markers) {
      seen.used = seen.frame >= rejected;
    } else if (other > 0) {
      seen.used = ++count % other != 0;
    }
  }
  return exact.Find(MarkerOutlierCause());
}

TEST(MarkerOutlierCauses, HaveAShareOfRejectedPointsThatChanceDoesNotGive) {
  struct Case {
    int rejected, of, other;
    bool found;
  };
  // Chernoff's bound for 1 % or the others' 20 % against 1e-4 / 70: 1.7e-7 and 1.9e-6 of 20 and 16
  // points, 2.3e-7 and 6.8e-6 of 40.
  for (const Case& each : {Case{6, 20, 0, true},
                           Case{5, 16, 0, false},
                           Case{12, 40, 0, true},
                           Case{11, 40, 0, false},  // less than 30 %
                           Case{24, 40, 5, true},
                           Case{22, 40, 5, false},
                           Case{40, 40, 5, true},
                           Case{40, 40, 1, false},
                           Case{1, 1, 0, false},
                           Case{0, 40, 0, false}}) {
    EXPECT_EQ(FindRejected(1, each.rejected, each.of, each.other).size(), each.found ? 1 : 0)
        << each.rejected << " of " << each.of << " beside " << each.other;
  }
  ExpectFinding(FindRejected(1, 12, 40),
                {.code = "marker_outlier",
                 .role = FindingRole::kOutlier,
                 .grade = Grade::kUsable,
                 .value = 0.3,
                 .limit = 0.3,
                 .what = "one marker disagrees with all others in most images; points rejected: "
                         "100 (12 of 40)."});
}

TEST(MarkerOutlierCauses, AreAtMostAQuarterOfTheMarkers) {
  EXPECT_THAT(FindRejected(18, 40, 40), IsEmpty());
  const std::vector<Finding> found = FindRejected(17, 40, 40);
  ASSERT_EQ(found.size(), 1);
  EXPECT_EQ(*found[0].value, 1);
  EXPECT_EQ(found[0].what,
            "some markers disagree with all others in most images; points rejected: 100 (40 of "
            "40), 101 (40 of 40), 102 (40 of 40), 103 (40 of 40), 104 (40 of 40), ....");
}

// 14 of 40 points of one of eight markers: the others' share is that without this one's points.
TEST(MarkerOutlierCauses, AreComparedWithTheOtherMarkers) {
  for (const bool others : {false, true}) {
    Exact exact(40);
    auto& observations = exact.calibration.bundle.observations;
    std::erase_if(observations, [](const auto& seen) { return seen.marker >= 8; });
    for (BundleObservation& seen : observations) {
      // A tenth of the other points.
      const bool bad = others && seen.frame % 10 == seen.marker;
      seen.used = !(seen.marker == 0 ? seen.frame < 14 : bad);
    }
    EXPECT_EQ(exact.Find(MarkerOutlierCause()).size(), others ? 0U : 1U);
  }
}

// Frames of the same pose, displaced against each other by `shift` px in x and y.
Exact WithCopies(const std::vector<std::pair<int, double>>& frames) {
  Exact exact(10);
  Bundle& bundle = exact.calibration.bundle;
  for (const auto& [frame, shift] : frames) {
    bundle.T_rig_target[static_cast<size_t>(frame)] =
        bundle.T_rig_target[static_cast<size_t>(frames[0].first)];
  }
  exact.Observe();
  exact.Displace([&](const BundleObservation& seen) {
    for (const auto& [frame, shift] : frames) {
      if (seen.frame == frame) return Eigen::Vector2d(shift, -shift);
    }
    return Eigen::Vector2d(0, 0);
  });
  return exact;
}

TEST(DuplicateImageCauses, DifferByLessThanHalfOfTheNoiseOfTwo) {
  const double limit = std::sqrt(2) * 0.5 * kSigma;
  EXPECT_THAT(WithCopies({{3, 0}, {6, 1.01 * limit}}).Find(DuplicateImagesCause()), IsEmpty());
  const Finding expected{.code = "duplicate_images",
                         .role = FindingRole::kOutlier,
                         .grade = Grade::kUsable,
                         .value = 1,
                         .limit = 1,
                         .what = "1 image is the same as another: f3 = f6."};
  ExpectFinding(WithCopies({{3, 0}, {6, 0.99 * limit}}).Find(DuplicateImagesCause()), expected);
  ExpectFinding(WithCopies({{6, 0}, {3, 0.99 * limit}}).Find(DuplicateImagesCause()), expected);
  // By the detector's noise where that is less.
  Exact stated = WithCopies({{3, 0}, {6, 0.99 * limit}});
  stated.calibration.fits[0].detector_sigma = 0.9 * kSigma;
  EXPECT_THAT(stated.Find(DuplicateImagesCause()), IsEmpty());
  stated.calibration.fits[0].detector_sigma = 2 * kSigma;
  EXPECT_EQ(stated.Find(DuplicateImagesCause()).size(), 1);
  // Exact points.
  stated.calibration.fits[0].noise_sigma = 0;
  EXPECT_THAT(stated.Find(DuplicateImagesCause()), IsEmpty());
}

// Of the same points, where the target is estimated to be at places 5 % of its distance apart,
// whatever is between them in the recording.
TEST(DuplicateImageCauses, ShowTheTargetAtOnePlace) {
  for (const double scale : {0.25, 4.0}) {
    for (const double part : {-0.055, -0.045, 0.045, 0.055}) {
      Exact exact = WithCopies({{3, 0}, {6, 0}});
      std::vector<RigidTransform>& poses = exact.calibration.bundle.T_rig_target;
      for (RigidTransform& pose : poses) pose.t *= scale;
      poses[6].t.x() = 0;
      poses[3].t = {0, 0, poses[6].t.norm()};
      poses[6].t.x() = part * poses[3].t.norm();
      poses[4].t.x() += 10;
      poses[5].t.x() -= 10;
      EXPECT_EQ(exact.Find(DuplicateImagesCause()).size(), std::abs(part) < 0.05 ? 1U : 0U)
          << scale << " " << part;
    }
  }
}

TEST(DuplicateImageCauses, AreEachNamedWithTheNextCopy) {
  const std::vector<Finding> found =
      WithCopies({{1, 0}, {8, 0.01}, {4, 0}}).Find(DuplicateImagesCause());
  ASSERT_EQ(found.size(), 1);
  EXPECT_EQ(*found[0].value, 2);
  EXPECT_EQ(found[0].what, "2 images are the same as another: f1 = f4, f4 = f8.");
}

TEST(DuplicateImageCauses, ShareSixPointsAndHalfOfTheLargerImage) {
  const auto find = [](int from_a, int to_a, int from_b, int to_b) {
    Exact exact = WithCopies({{3, 0}, {6, 0}});
    std::erase_if(exact.calibration.bundle.observations, [&](const BundleObservation& seen) {
      return (seen.frame == 3 && (seen.marker < from_a || seen.marker >= to_a)) ||
             (seen.frame == 6 && (seen.marker < from_b || seen.marker >= to_b));
    });
    return exact.Find(DuplicateImagesCause()).size();
  };
  EXPECT_EQ(find(0, 6, 0, 6), 1);
  EXPECT_EQ(find(0, 5, 0, 5), 0);
  EXPECT_EQ(find(0, 70, 35, 70), 1);
  EXPECT_EQ(find(0, 70, 36, 70), 0);
  EXPECT_EQ(find(35, 70, 0, 70), 1);
  EXPECT_EQ(find(36, 70, 0, 70), 0);
  EXPECT_EQ(find(0, 12, 6, 18), 1);
  EXPECT_EQ(find(0, 12, 7, 19), 0);
}

TEST(DuplicateImageCauses, HaveNoPointFarOff) {
  // One point by ten times the limit of the mean; 70 points take that as a mean.
  const double limit = 10 * std::sqrt(2) * 0.5 * kSigma;
  for (const double factor : {0.99, 1.01}) {
    Exact exact = WithCopies({{3, 0}, {6, 0}});
    exact.Displace([&](const BundleObservation& seen) {
      return Eigen::Vector2d(seen.frame == 6 && seen.marker == 5 ? factor * limit : 0, 0);
    });
    EXPECT_EQ(exact.Find(DuplicateImagesCause()).size(), factor < 1 ? 1 : 0);
  }
}

TEST(DuplicateImageCauses, CompareEachOccurrenceOfAMarker) {
  for (const bool same : {true, false}) {
    Exact exact = WithCopies({{3, 0}, {6, 0}});
    auto& observations = exact.calibration.bundle.observations;
    for (size_t i = 0; i < observations.size(); i += 2) {
      BundleObservation again = observations[i];
      again.seen.values[0] += again.frame == 3 || same ? 7 : 9;
      observations.insert(observations.begin() + static_cast<std::ptrdiff_t>(i) + 1, again);
    }
    EXPECT_EQ(exact.Find(DuplicateImagesCause()).size(), same ? 1 : 0);
  }
}

TEST(FocusChangedCauses, MeasureTheMagnificationOfTheSecondPart) {
  const auto find = [](int frames, int first, double change) {
    Exact exact(frames);
    exact.Displace([&](const BundleObservation& seen) {
      const Eigen::Vector2d p(seen.seen.values[0], seen.seen.values[1]);
      return Eigen::Vector2d((seen.frame >= first ? change : 0) * (p - kMiddle));
    });
    return exact.Find(FocusChangedCause());
  };
  Finding expected{.code = "focus_changed",
                   .role = FindingRole::kCause,
                   .grade = Grade::kUsable,
                   .value = 0.05,
                   .limit = 0,
                   .what =
                       "focus or zoom changed during the recording: from frame f5 on the image "
                       "is 5.00 % larger than before."};
  ExpectFinding(find(12, 5, 0.05), expected);
  expected.value = -0.05;
  expected.what =
      "focus or zoom changed during the recording: from frame f5 on the image is 5.00 % smaller "
      "than before.";
  ExpectFinding(find(8, 5, -0.05), expected);
  EXPECT_THAT(find(7, 4, 0.05), IsEmpty());
  EXPECT_THAT(find(12, 0, 0.05), IsEmpty());
  EXPECT_THAT(find(12, 5, 1e-6), IsEmpty());  // far below the noise
}

// A motion of the target that is proportional to the row, another in each frame.
TEST(RollingShutterCauses, ExplainResidualsByTheRow) {
  const auto find = [](int frames, double common, int least_marker = 0) {
    Exact exact(frames);
    Bundle& bundle = exact.calibration.bundle;
    std::erase_if(bundle.observations, [&](const auto& o) { return o.marker < least_marker; });
    exact.Displace([&](const BundleObservation& seen) {
      const Eigen::Vector3d p = bundle.T_rig_target[static_cast<size_t>(seen.frame)] *
                                bundle.markers[static_cast<size_t>(seen.marker)].position;
      const double row = (seen.seen.values[1] - kMiddle.y()) / 960;
      const double angle = 2.4 * seen.frame;
      const Eigen::Vector3d velocity(0.01 * std::cos(angle), 0.01 * std::sin(angle), 0);
      const double noise = 0.02 * std::sin(71.0 * seen.marker + 13.0 * seen.frame);
      return Eigen::Vector2d(row * kFocal * velocity.head<2>() / p.z() +
                             Eigen::Vector2d(noise, -noise) +
                             common * Eigen::Vector2d(std::sin(seen.marker), 0));
    });
    exact.FitPoses();
    return exact.Find(RollingShutterCause());
  };
  const std::vector<Finding> found = find(12, 0);
  ASSERT_EQ(found.size(), 1);
  EXPECT_EQ(found[0].role, FindingRole::kImageDistortion);
  EXPECT_EQ(found[0].grade, Grade::kUsable);
  EXPECT_EQ(*found[0].limit, 0);
  EXPECT_LE(*found[0].value, kSigma);
  EXPECT_GT(*found[0].value, 0.7 * kSigma);
  EXPECT_EQ(found[0].what,
            fmt::format("in each frame the residuals depend on the image row as by a motion during "
                        "the readout ({:.2g} px RMS): a rolling shutter and a camera or target "
                        "that moved.",
                        *found[0].value));
  EXPECT_EQ(find(4, 0).size(), 1);
  EXPECT_THAT(find(3, 0), IsEmpty());
  EXPECT_THAT(find(12, 10), IsEmpty());  // most of it the same in all views
  EXPECT_EQ(find(12, 0, 70 - 18).size(), 1);
  EXPECT_THAT(find(12, 0, 70 - 17), IsEmpty());
}

TEST(ImagesRotatedCauses, NameViewsThatFitTurned) {
  // With the middle of the lens beside that of the image: else a turned target takes its place.
  const auto find = [](std::vector<int> turned, int markers, double noise) {
    Exact exact(9, 2);
    for (BundleCamera& camera : exact.calibration.bundle.cameras) {
      camera.image_size = {1280 - 400, 960 - 300};
    }
    exact.Displace([](const BundleObservation& seen) {
      const double a = 10.0 * seen.marker + seen.frame;
      return Eigen::Vector2d(kSigma * Eigen::Vector2d(std::sin(a), std::cos(a)));
    });
    auto& observations = exact.calibration.bundle.observations;
    for (BundleObservation& seen : observations) {
      if (seen.camera != 1 || !std::ranges::count(turned, seen.frame)) continue;
      seen.seen.values[0] = 879 - seen.seen.values[0];
      seen.seen.values[1] = 659 - seen.seen.values[1];
    }
    std::erase_if(observations, [&](const auto& seen) {
      return seen.frame == 4 && seen.marker % 10 + seen.marker / 10 >= markers;
    });
    exact.calibration.fits[1].noise_sigma = noise;
    EXPECT_THAT(exact.Find(ImagesRotatedCause(), 0), IsEmpty());
    return exact.Find(ImagesRotatedCause(), 1);
  };
  EXPECT_THAT(find({}, 99, kSigma), IsEmpty());
  Finding expected{.code = "images_rotated",
                   .role = FindingRole::kImageDistortion,
                   .grade = Grade::kUsable,
                   .value = 1,
                   .limit = 1,
                   .what =
                       "1 of 9 images is upside down: turned by 180 degrees they agree with "
                       "the others: f4."};
  ExpectFinding(find({4}, 99, kSigma), expected);
  expected.value = 3;
  expected.what =
      "3 of 9 images are upside down: turned by 180 degrees they agree with the others: f0, f4, "
      "f7.";
  ExpectFinding(find({0, 4, 7}, 99, kSigma), expected);
  EXPECT_THAT(find({4}, 3, kSigma), IsEmpty());  // 6 points
  EXPECT_THAT(find({4}, 99, 100), IsEmpty());    // no more than noise
}

TEST(OrientationTagCauses, CountImages) {
  Exact exact(1);
  exact.traits["a"].orientation = 1;
  EXPECT_THAT(exact.Find(OrientationTagCause()), IsEmpty());
  exact.traits["b"].orientation = 3;
  Finding expected{.code = "orientation_tag",
                   .grade = Grade::kGood,
                   .value = 1,
                   .limit = 1,
                   .what =
                       "one image has an orientation tag (EXIF), by which viewers turn it; "
                       "pixels are used as the sensor recorded them."};
  ExpectFinding(exact.Find(OrientationTagCause()), expected);
  exact.traits["c"].orientation = 8;
  expected.value = 2;
  expected.what =
      "2 images have an orientation tag (EXIF), by which viewers turn them; pixels are used as the "
      "sensor recorded them.";
  ExpectFinding(exact.Find(OrientationTagCause()), expected);
}

struct Band {
  int points = 0;
  double margin = 0;  ///< from the outermost pixel's middle, px
  double length = 0;  ///< geometric mean of the residuals, px
};

// Points in bands along the border, on its four sides in turn; the logarithms of the residuals'
// lengths scatter by `scatter`.
std::vector<Finding> FindAtBorder(const std::vector<Band>& bands, double scatter = 0.05) {
  Exact exact(1);
  Bundle& bundle = exact.calibration.bundle;
  bundle.T_rig_target[0] = {Eigen::Matrix3d::Identity(), {0, 0, 1}};
  bundle.markers.clear();
  std::vector<double> lengths;
  for (const Band& band : bands) {
    for (int i = 0; i < band.points; ++i) {
      const double along = 200 + 10 * i;
      Eigen::Vector2d at(along, band.margin);
      if (i % 4 == 1) at.y() = 959 - band.margin;
      if (i % 4 >= 2) at = {band.margin, along};
      if (i % 4 == 3) at.x() = 1279 - band.margin;
      const Eigen::Vector2d p = (at - kMiddle) / kFocal;
      bundle.markers.push_back(
          {.number = 1, .position = {p.x(), p.y(), 0}, .nominal = Eigen::Vector3d::Zero()});
      lengths.push_back(band.length * std::exp(i % 2 == 0 ? scatter : -scatter));
    }
  }
  exact.Observe();
  exact.Displace([&](const BundleObservation& seen) {
    // Along the border, so that the margin stays.
    const size_t i = static_cast<size_t>(seen.marker);
    const bool upright = seen.seen.values[0] < 100 || seen.seen.values[0] > 1200;
    return Eigen::Vector2d(upright ? Eigen::Vector2d(0, lengths[i])
                                   : Eigen::Vector2d(lengths[i], 0));
  });
  return exact.Find(PointsAtBorderCause());
}

TEST(BorderPoints, AreComparedWithTheNextBandTwiceAsWide) {
  const Finding expected{.code = "border_points",
                         .role = FindingRole::kOutlier,
                         .grade = Grade::kUsable,
                         .value = 2.5,
                         .limit = 2,
                         .what =
                             "the 12 points within 4 px of the image's border have 2.5 times "
                             "the residuals of their neighbours."};
  // The margin of a point counts from the border of its pixel.
  ExpectFinding(FindAtBorder({{12, 3.4, 0.25}, {12, 3.6, 0.1}}), expected, 1e-3);
  ExpectFinding(FindAtBorder({{12, 3.4, 0.25}, {12, 11.4, 0.1}, {40, 11.6, 5}}), expected, 1e-3);
  EXPECT_THAT(FindAtBorder({{12, 3.6, 0.1}, {12, 3.4, 0.1}}), IsEmpty());
  for (const double width : {4.0, 8.0, 16.0, 32.0}) {
    const std::vector<Finding> found =
        FindAtBorder({{12, width - 0.6, 0.25}, {12, width - 0.4, 0.1}});
    ASSERT_EQ(found.size(), 1) << width;
    EXPECT_THAT(found[0].what, HasSubstr(fmt::format("within {:g} px", width)));
  }
  EXPECT_THAT(FindAtBorder({{12, 63.4, 0.25}, {12, 63.6, 0.1}}), IsEmpty());
}

TEST(BorderPoints, AreTenTwiceAsBadAndNotByChance) {
  EXPECT_EQ(FindAtBorder({{10, 2, 0.25}, {10, 6, 0.1}}).size(), 1);
  EXPECT_THAT(FindAtBorder({{9, 2, 0.25}, {20, 6, 0.1}}), IsEmpty());
  EXPECT_THAT(FindAtBorder({{20, 2, 0.25}, {9, 6, 0.1}}), IsEmpty());
  EXPECT_EQ(FindAtBorder({{12, 2, 0.202}, {12, 6, 0.1}}).size(), 1);
  EXPECT_THAT(FindAtBorder({{12, 2, 0.198}, {12, 6, 0.1}}), IsEmpty());
  // t of the difference ln(2.5) with 18 degrees of freedom, against 1e-4 / 4.
  for (const double scatter : {0.3, 0.35, 0.4, 0.45, 0.5}) {
    const double variance = 20 * scatter * scatter / 18 * (2.0 / 10);
    const bool chance = StudentTail(std::log(2.5) / std::sqrt(variance), 18) > 1e-4 / 4;
    EXPECT_EQ(FindAtBorder({{10, 2, 0.25}, {10, 6, 0.1}}, scatter).empty(), chance) << scatter;
  }
}

// A rig of two cameras that would see the same, with jitter of the second one.
struct Jittered : Exact {
  explicit Jittered(int frames) : Exact(frames, 2) {
    bundle.jitter.delta.assign(2 * static_cast<size_t>(frames), Vector6d::Zero());
  }
  void Set(const std::function<Vector6d(int)>& of_frame) {
    for (size_t f = 0; f < bundle.T_rig_target.size(); ++f) {
      bundle.jitter.delta[bundle.View(f, 1)] = of_frame(static_cast<int>(f));
    }
    Observe();
  }
  Bundle& bundle = calibration.bundle;
};

TEST(RigMotionCauses, CountFramesThatArePairedWrongly) {
  const auto find = [](int frames, int shift) {
    Jittered exact(frames + 5);
    const std::vector<RigidTransform>& poses = exact.bundle.T_rig_target;
    exact.Set([&](int f) -> Vector6d {
      const int other = std::clamp(f - shift, 0, frames + 4);
      return LocalCoordinates(poses[static_cast<size_t>(f)], poses[static_cast<size_t>(other)]);
    });
    std::erase_if(exact.bundle.observations, [&](const auto& o) { return o.frame >= frames; });
    return exact.Find(RigMotionCause());
  };
  Finding expected{.code = "frames_misaligned",
                   .role = FindingRole::kCause,
                   .grade = Grade::kBad,
                   .cameras = {"cam1"},
                   .value = 2,
                   .limit = 0,
                   .what =
                       "cam1: its images are paired wrongly: the motion of the target agrees "
                       "with that in cam0 when each image belongs to the frame 2 before."};
  ExpectFinding(find(16, 2), expected);
  expected.value = -1;
  expected.what =
      "cam1: its images are paired wrongly: the motion of the target agrees with that in cam0 when "
      "each image belongs to the frame one after.";
  ExpectFinding(find(16, -1), expected);
  for (const int shift : {-5, 5}) EXPECT_EQ(*find(20, shift).at(0).value, shift);
  EXPECT_NE(find(20, 6).at(0).code, "frames_misaligned");
  // Five turns that can be compared.
  EXPECT_EQ(find(7, 1).at(0).code, "frames_misaligned");
  EXPECT_NE(find(6, 1).at(0).code, "frames_misaligned");
}

TEST(RigMotionCauses, MeasureTheDisplacementInTheImages) {
  const auto find = [](int frames, double metres, bool step, Eigen::Index axis) {
    Jittered exact(frames);
    for (RigidTransform& pose : exact.bundle.T_rig_target) pose.t = {0, 0, 1};
    exact.Set([&](int f) {
      Vector6d delta;
      for (Eigen::Index i = 0; i < 6; ++i) delta[i] = 1e-7 * std::sin(17.0 * f + 5.0 * i);
      delta[axis] += metres * ((step ? f < 4 : f % 2 == 0) ? 1 : -1);
      return delta;
    });
    return exact.Find(RigMotionCause());
  };
  // A target at 1 m that is displaced along x: about 1000 px a metre, in one of two cameras.
  const auto expect = [](const std::vector<Finding>& found, bool moved, double px, Grade grade) {
    ASSERT_EQ(found.size(), 1);
    EXPECT_EQ(found[0].code, moved ? "rig_not_rigid" : "not_synchronous");
    EXPECT_EQ(found[0].role, FindingRole::kRigCause);
    EXPECT_EQ(found[0].grade, grade);
    EXPECT_THAT(found[0].cameras, IsEmpty());
    EXPECT_NEAR(*found[0].value, px, 0.03 * px);
    EXPECT_EQ(*found[0].limit, grade == Grade::kBad ? 1 : 0);
    EXPECT_EQ(found[0].what,
              moved ? fmt::format("A camera moved on the rig during the recording: the "
                                  "disagreement of its poses ({:.2g} px in the images) persists "
                                  "from frame to frame.",
                                  *found[0].value)
                    : fmt::format("The images of a frame were not taken at the same time: the "
                                  "poses of the cameras disagree by {:.2g} px in the images, in "
                                  "each frame by another error.",
                                  *found[0].value));
  };
  expect(find(10, 0.001, false, 0), false, 1 / std::sqrt(2), Grade::kUsable);
  expect(find(10, 0.002, false, 0), false, 2 / std::sqrt(2), Grade::kBad);
  expect(find(10, 0.001, true, 0), true, 1 / std::sqrt(2), Grade::kUsable);
  expect(find(10, -0.002, true, 1), true, 2 / std::sqrt(2), Grade::kBad);
  EXPECT_EQ(find(10, 0.01, true, 5).at(0).code, "rig_not_rigid");  // a rotation
  EXPECT_EQ(find(7, 0.001, true, 0).at(0).code, "rig_not_rigid");
  EXPECT_EQ(find(6, 0.001, true, 0).at(0).code, "not_synchronous");
}

// Images whose edges, gray levels or spacing are `worse` in the first `bad` ones, with residuals
// that are `factor` times as large there.
std::vector<Finding> FindWorse(int images,
                               int bad,
                               double factor,
                               const std::function<void(bool is_bad, ImageTraits*)>& set,
                               double far = 1) {
  Exact exact(images);
  Bundle& bundle = exact.calibration.bundle;
  for (int f = 0; f < images; ++f) {
    bundle.T_rig_target[static_cast<size_t>(f)] = {Eigen::Matrix3d::Identity(),
                                                   {0, 0, f < bad ? far : 1}};
    set(f < bad, &exact.traits["f" + std::to_string(f)]);
  }
  exact.Observe();
  exact.SetLengths(
      [&](int f) { return (f < bad ? factor : 1) * std::exp(f % 2 == 0 ? 0.05 : -0.05); });
  return exact.Find(WorseImagesCause());
}

TEST(WorseImageCauses, NameTheDefectWithItsSize) {
  const auto nothing = [](bool, ImageTraits*) {};
  const auto blur = [](bool bad, ImageTraits* traits) { traits->blur = bad ? 3 : 0.7; };
  const auto saturate = [](bool bad, ImageTraits* traits) { traits->saturated = bad ? 0.3 : 0.02; };
  Finding expected{.code = "blurred_images",
                   .role = FindingRole::kImageDefect,
                   .grade = Grade::kGood,
                   .value = 5,
                   .limit = 1,
                   .what =
                       "4 images in which the target is blurred have 5.0 times the residuals "
                       "of the others (edges have a sigma of 3.0 px there, else 0.7 px)."};
  ExpectFinding(FindWorse(12, 4, 5, blur), expected, 0.01);
  expected.code = "saturated_images";
  expected.what =
      "4 images in which the target is saturated have 5.0 times the residuals of the others (30 % "
      "of the target's area have the largest gray level, else 2 %).";
  ExpectFinding(FindWorse(12, 4, 5, saturate), expected, 0.01);
  expected.code = "few_pixels";
  expected.what =
      "4 images in which the target is too small have 5.0 times the residuals of the others "
      "(neighbouring points are 10 px apart there, else 30 px).";
  ExpectFinding(FindWorse(12, 4, 5, nothing, 3), expected, 0.01);
  EXPECT_THAT(FindWorse(12, 4, 5, nothing), IsEmpty());
}

TEST(WorseImageCauses, BeginWhereADefectExplainsHalfOfTheNoise) {
  const auto blur = [](double worse) {
    return [worse](bool bad, ImageTraits* traits) { traits->blur = bad ? worse : 1; };
  };
  EXPECT_EQ(FindWorse(12, 4, 5, blur(2.01)).size(), 1);
  EXPECT_THAT(FindWorse(12, 4, 5, blur(1.99)), IsEmpty());
  EXPECT_THAT(FindWorse(12, 4, 5, blur(0.2)), IsEmpty());  // sharper images are worse
  EXPECT_EQ(FindWorse(12, 3, 5, blur(3)).size(), 1);
  EXPECT_THAT(FindWorse(12, 2, 5, blur(3)), IsEmpty());
  EXPECT_EQ(FindWorse(7, 3, 9, blur(3)).size(), 1);
  EXPECT_THAT(FindWorse(6, 3, 9, blur(3)), IsEmpty());
  // Mean squares: (4 k^2 + 8) / 12 = 2 at k = 2.
  EXPECT_EQ(FindWorse(12, 4, 2.03, blur(3)).size(), 1);
  EXPECT_THAT(FindWorse(12, 4, 1.97, blur(3)), IsEmpty());
}

}  // namespace TEST_FILE
}  // namespace testing
}  // namespace plenocal
