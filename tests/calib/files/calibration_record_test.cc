// SPDX-License-Identifier: Apache-2.0
//
// A calibration's result through its files and back.
#include "calib/files/calibration_record.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>

#include "calib/base/error.h"
#include "calib/files/calibration_file.h"
#include "calib/files/calibration_tables.h"
#include "calib/io/input_file.h"
#include "models/registry.h"
#include "tests/refusal.h"
#include "tests/temporary_folder.h"

namespace plenocal {
namespace TEST_FILE {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

constexpr double kInfinite = std::numeric_limits<double>::infinity();
constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kFileDigits = 1e-11;  // of numbers that files hold with 12 significant digits
constexpr double kDenormal = 1e-310;

RigidTransform SomePose(double w) {
  return Exp((Vector6d() << 0.1, w, -0.3, w, 0.2, -w).finished());
}

CalibratedCamera Ordinary() {
  CalibratedCamera camera{.name = "left",
                          .model = FindModel(CameraModels(), "pinhole-radial3"),
                          .image_size = {640, 480},
                          .image_circle = ImageCircle{{310.5, 245}, {280, 200.25}},
                          .config = {},
                          .params = {500.1, 501, 319.5, 239.5, -0.2, 1.0 / 3, kDenormal},
                          .covariance = {},
                          .T_camera_rig = {}};
  Eigen::MatrixXd correlation = Eigen::MatrixXd::Identity(7, 7);
  correlation(0, 1) = correlation(1, 0) = 0.97;
  correlation(4, 5) = correlation(5, 4) = -0.5;
  camera.covariance = CovarianceOf({0.1, 0.2, 0, 0.3, 0.01, 0.02, kInfinite}, correlation);
  camera.at_bound = {"c_x"};
  camera.sigma_jackknife = {0.11, 0.21, 0, 0.31, 0.011, 0.021, kInfinite};
  camera.sigma_xi_jackknife = {0, 0, 0, 0, 0, 0};
  camera.fit.points = 3;
  camera.fit.rejected = 1;
  camera.fit.views = 2;
  camera.fit.rms = 0.25;
  camera.fit.noise_sigma = 0.125;
  camera.fit.detector_sigma = 0.1;
  camera.fit.common_noise = 0.05;
  camera.view_poses = {{0, {SomePose(0.4), false}}, {1, {SomePose(0.5), true}}};
  camera.residuals = {{.frame = 0,
                       .marker = 7,
                       .values = {12.25, 99},
                       .residual = {0.125, -0.5},
                       .noise_sigma = 0.1,
                       .used = true},
                      {.frame = 1,
                       .marker = 8,
                       .values = {1, 2},
                       .residual = {kNone, kNone},
                       .noise_sigma = 0.2,
                       .used = false}};
  return camera;
}

CalibratedCamera Plenoptic() {
  const CameraModel* model = FindModel(CameraModels(), "focused-plenoptic");
  CalibratedCamera camera{.name = "plenoptic",
                          .model = model,
                          .image_size = {2048, 2000},
                          .config = {5.5e-6},
                          .params = {0.016, 0.0155, 0.0003, 1020, 1000, 0, 0, 0, 0},
                          .covariance = Eigen::MatrixXd::Zero(9, 9),
                          .T_camera_rig = SomePose(0.2)};
  camera.sigma_xi << 1e-4, 2e-4, 3e-4, 1e-3, kInfinite, 3e-3;
  camera.nuisances = {{-0.75, 0.125}, {1.5, kInfinite}};
  camera.micro_lenses = "micro_lenses_plenoptic.csv";
  camera.lattice = "lattice_plenoptic.yaml";
  camera.vignetting = "vignetting_plenoptic.tiff";
  camera.sample = "sample_plenoptic.jpg";
  camera.sample_frame = "0001: \"quoted\"";
  camera.fit.lens_types = {{0, {0, 0.5}}, {2, {0, 0.75}}};
  camera.fit.noise_floor = NoiseFloor{.length = 0.4};
  camera.fit.noise_floor_all = NoiseFloor{.length = 0.6};
  camera.fit.rms_all = 0.7;
  camera.residuals = {{.frame = 1,
                       .marker = 7,
                       .values = {1000.5, 999, 1001, 1002.25},
                       .residual = {0.25, 0.75},
                       .noise_sigma = 0.3,
                       .used = true}};
  return camera;
}

CalibrationRecord Record() {
  CalibrationRecord record;
  record.cameras = {Ordinary(), Plenoptic()};
  record.frames = {{"0001", SomePose(0.1)}, {"b", SomePose(-0.6)}};
  record.markers = {{7, {}}, {8, {}}};
  record.adjustment = {.converged = true,
                       .iterations = 12,
                       .rejection_sigmas = 4.5,
                       .marker_freedom = MarkerFreedom::FromSigma(0.0003)};
  record.jitter = {.translation_sigma = 0.001, .rotation_sigma = 0.002, .misplaced = 1};
  record.correlations = {{"left.f_x", "left.f_y"}, Eigen::MatrixXd::Identity(2, 2)};
  record.correlations.matrix(0, 1) = record.correlations.matrix(1, 0) = 0.97;
  record.target_scales = {{"wall.scale_x", {0.001, 0.0005}}, {"wall.scale_y", {-0.002, 0.0005}}};
  record.undetermined = {{{{"left.A_2", 1}, {"left.f_x", -0.5}}, kInfinite}};
  record.weak = {
      {.open = true, .names = {"left.A_2"}, .what = "not \"seen\"", .remedy = "Do: that."},
      {.open = false, .names = {"left.f_x", "left.f_y"}, .what = "x", .remedy = "y"}};
  record.verdict = {.grade = Grade::kBad,
                    .findings = {{.code = "noise_excess",
                                  .grade = Grade::kBad,
                                  .cameras = {"left"},
                                  .value = 2.5,
                                  .limit = 1,
                                  .what = "a: text \\ with # signs",
                                  .remedy = "b"},
                                 {.code = "projection", .what = "c"}}};
  record.left_out = {"left 0001: blurred"};
  record.provenance = {{"command", "plenocal calibrate"}, {"session_text", "a: 1\nb: \"2\"\n"}};
  return record;
}

class RecordFiles : public testing::InTemporaryFolder {
 protected:
  CalibrationRecord Again(const CalibrationRecord& record) {
    return ReadCalibration(Write("calibration.yaml", CalibrationYaml(record)), CameraModels());
  }
};

void ExpectSame(const RigidTransform& a, const RigidTransform& b, double tolerance) {
  EXPECT_LE((a.R - b.R).cwiseAbs().maxCoeff(), tolerance);
  EXPECT_LE((a.t - b.t).cwiseAbs().maxCoeff(), tolerance);
}

TEST(CalibrationRecordInMemory, HasNoFilesBesideIt) {
  CalibrationRecord record;
  EXPECT_THROW((void)FileBeside(record, "vignetting_left.tiff"), Error);
  record.path = "runs/calibration.yaml";
  EXPECT_EQ(FileBeside(record, "vignetting_left.tiff"), "runs/vignetting_left.tiff");
}

TEST_F(RecordFiles, KeepModelsParametersAndExtrinsicsExactly) {
  const CalibrationRecord record = Record(), again = Again(record);
  ASSERT_EQ(again.cameras.size(), 2);
  for (size_t c = 0; c < 2; ++c) {
    const CalibratedCamera &a = record.cameras[c], &b = again.cameras[c];
    EXPECT_EQ(b.name, a.name);
    EXPECT_EQ(b.model, a.model);
    EXPECT_EQ(b.image_size, a.image_size);
    ASSERT_EQ(b.image_circle.has_value(), a.image_circle.has_value());
    if (a.image_circle) {
      EXPECT_EQ(b.image_circle->centre, a.image_circle->centre);
      EXPECT_EQ(b.image_circle->radii, a.image_circle->radii);
    }
    EXPECT_EQ(b.config, a.config);
    EXPECT_EQ(b.params, a.params) << "to the last digit, next to a limit and denormal ones too";
    ExpectSame(b.T_camera_rig, a.T_camera_rig, 0);
    for (const auto& [key, member] : kCameraTextKeys) EXPECT_EQ(b.*member, a.*member) << key;
  }
  EXPECT_EQ(again.provenance, record.provenance);
}

TEST_F(RecordFiles, KeepUncertainties) {
  const CalibrationRecord record = Record(), again = Again(record);
  for (size_t c = 0; c < 2; ++c) {
    const CalibratedCamera &a = record.cameras[c], &b = again.cameras[c];
    ASSERT_EQ(b.covariance.rows(), a.covariance.rows());
    for (Eigen::Index i = 0; i < a.covariance.rows(); ++i) {
      for (Eigen::Index j = 0; j < a.covariance.cols(); ++j) {
        if (std::isinf(a.covariance(i, j))) {
          EXPECT_EQ(b.covariance(i, j), a.covariance(i, j));
        } else {
          EXPECT_NEAR(b.covariance(i, j), a.covariance(i, j), kFileDigits);
        }
      }
    }
    EXPECT_EQ(b.sigma_xi, a.sigma_xi);
    EXPECT_EQ(b.nuisances, a.nuisances);
    EXPECT_EQ(b.at_bound, a.at_bound);
    EXPECT_EQ(b.sigma_jackknife, a.sigma_jackknife);
    EXPECT_EQ(b.sigma_xi_jackknife, a.sigma_xi_jackknife);
  }
  EXPECT_EQ(again.target_scales, record.target_scales);
  CalibrationRecord one = record;
  one.target_scales = {{"target.scale", {0.003, 0.0001}}};
  EXPECT_EQ(Again(one).target_scales, one.target_scales);
  EXPECT_TRUE(std::isinf(again.cameras[0].Sigma(6)));
  EXPECT_EQ(again.cameras[0].Sigma(2), 0);
}

TEST_F(RecordFiles, KeepTheFitOfEachCamera) {
  const CalibrationRecord record = Record(), again = Again(record);
  for (size_t c = 0; c < 2; ++c) {
    const CameraFit &a = record.cameras[c].fit, &b = again.cameras[c].fit;
    EXPECT_EQ(b.points, a.points);
    EXPECT_EQ(b.rejected, a.rejected);
    EXPECT_EQ(b.views, a.views);
    EXPECT_EQ(b.rms, a.rms);
    EXPECT_EQ(b.noise_sigma, a.noise_sigma);
    EXPECT_EQ(b.detector_sigma, a.detector_sigma);
    EXPECT_EQ(b.common_noise, a.common_noise);
    EXPECT_EQ(b.rms_all, a.rms_all);
    ASSERT_EQ(b.noise_floor.has_value(), a.noise_floor.has_value());
    ASSERT_EQ(b.noise_floor_all.has_value(), a.noise_floor_all.has_value());
    if (a.noise_floor) {
      EXPECT_EQ(b.noise_floor->length, a.noise_floor->length);
    }
    if (a.noise_floor_all) {
      EXPECT_EQ(b.noise_floor_all->length, a.noise_floor_all->length);
    }
    ASSERT_EQ(b.lens_types.size(), a.lens_types.size());
    for (const auto& [type, fit] : a.lens_types) EXPECT_EQ(b.lens_types.at(type).rms, fit.rms);
  }
}

TEST_F(RecordFiles, KeepHowTheAdjustmentEnded) {
  const CalibrationRecord record = Record(), again = Again(record);
  ASSERT_TRUE(again.adjustment);
  EXPECT_EQ(again.adjustment->converged, record.adjustment->converged);
  EXPECT_EQ(again.adjustment->iterations, record.adjustment->iterations);
  EXPECT_EQ(again.adjustment->rejection_sigmas, record.adjustment->rejection_sigmas);
  EXPECT_EQ(again.adjustment->marker_freedom.Sigma(), record.adjustment->marker_freedom.Sigma());
  ASSERT_TRUE(again.jitter);
  EXPECT_EQ(again.jitter->translation_sigma, record.jitter->translation_sigma);
  EXPECT_EQ(again.jitter->rotation_sigma, record.jitter->rotation_sigma);
  EXPECT_EQ(again.jitter->misplaced, record.jitter->misplaced);
  ASSERT_EQ(again.undetermined.size(), 1);
  EXPECT_EQ(again.undetermined[0].parts, record.undetermined[0].parts);
  EXPECT_EQ(again.undetermined[0].sigma, kInfinite);
  ASSERT_EQ(again.weak.size(), 2);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(again.weak[i].open, record.weak[i].open);
    EXPECT_EQ(again.weak[i].names, record.weak[i].names);
    EXPECT_EQ(again.weak[i].what, record.weak[i].what);
    EXPECT_EQ(again.weak[i].remedy, record.weak[i].remedy);
  }
  ASSERT_TRUE(again.verdict);
  EXPECT_EQ(again.verdict->grade, record.verdict->grade);
  ASSERT_EQ(again.verdict->findings.size(), 2);
  for (size_t i = 0; i < 2; ++i) {
    const Finding &read = again.verdict->findings[i], &written = record.verdict->findings[i];
    EXPECT_EQ(read.code, written.code);
    EXPECT_EQ(read.grade, written.grade);
    EXPECT_EQ(read.cameras, written.cameras);
    EXPECT_EQ(read.value, written.value);
    EXPECT_EQ(read.limit, written.limit);
    EXPECT_EQ(read.what, written.what);
    EXPECT_EQ(read.remedy, written.remedy);
  }
  EXPECT_EQ(again.left_out, record.left_out);
}

TEST_F(RecordFiles, KeepOpticsClocksAndTargets) {
  CalibrationRecord record = Record();
  record.cameras[0].time_shift = EstimatedNumber{-0.0125, kInfinite};
  record.cameras[1].lens_type_optics = {
      {0, 0.0011, 2e-5, 1.5e-4, 3e-6, 0.625, 0.5, 0.75},
      {2, 0.0012, 3e-5, 1.25e-4, 2e-6, kInfinite, 1.25, kInfinite}};
  record.cameras[1].fit.noise_floor->third_order = 0.375;
  record.cameras[1].fit.noise_floor_all->third_order = 0.5;
  record.targets = {{"first", {}, Vector6d::Zero()},
                    {"wall: left", SomePose(0.3), Vector6d::Constant(0.25)}};
  const CalibrationRecord again = Again(record);
  ASSERT_TRUE(again.cameras[0].time_shift);
  EXPECT_EQ(*again.cameras[0].time_shift, *record.cameras[0].time_shift);
  EXPECT_FALSE(again.cameras[1].time_shift);
  EXPECT_EQ(again.cameras[1].fit.noise_floor->third_order, 0.375);
  EXPECT_EQ(again.cameras[1].fit.noise_floor_all->third_order, 0.5);
  ASSERT_EQ(again.cameras[1].lens_type_optics.size(), 2U);
  for (size_t i = 0; i < 2; ++i) {
    const LensTypeOptics &a = record.cameras[1].lens_type_optics[i],
                         &b = again.cameras[1].lens_type_optics[i];
    EXPECT_EQ(b.lens_type, a.lens_type);
    EXPECT_EQ(b.focal_length, a.focal_length);
    EXPECT_EQ(b.focal_length_sigma, a.focal_length_sigma);
    EXPECT_EQ(b.aperture, a.aperture);
    EXPECT_EQ(b.aperture_sigma, a.aperture_sigma);
    EXPECT_EQ(b.in_focus, a.in_focus);
    EXPECT_EQ(b.near, a.near);
    EXPECT_EQ(b.far, a.far);
  }
  ASSERT_EQ(again.targets.size(), 2U);
  for (size_t i = 0; i < 2; ++i) {
    EXPECT_EQ(again.targets[i].name, record.targets[i].name);
    ExpectSame(again.targets[i].T_target_own, record.targets[i].T_target_own, kFileDigits);
    EXPECT_EQ(again.targets[i].sigma_xi, record.targets[i].sigma_xi);
  }
}

TEST(MicroLensGeometryOfACamera, HasItsDistances) {
  CalibratedCamera camera = Plenoptic();
  camera.covariance(2, 2) = 4e-10;
  const std::optional<MicroLensGeometry> thin = MicroLensGeometryOf(camera);
  ASSERT_TRUE(thin);
  EXPECT_EQ(thin->f_L, 0.016);
  EXPECT_EQ(thin->b_L0, 0.0155);
  EXPECT_EQ(thin->B, 0.0003);
  EXPECT_EQ(thin->b_P, 0.0155) << "the pupil of a thin lens is the lens";
  EXPECT_EQ(thin->pixel_size, 5.5e-6);
  EXPECT_DOUBLE_EQ(thin->sigma_B, 2e-5);
  EXPECT_EQ(thin->principal_point, Eigen::Vector2d(1020, 1000));
  EXPECT_EQ(thin->tilt, Eigen::Vector2d(0, 0));
  const auto with = [&](const char* model, std::initializer_list<double> more) {
    CalibratedCamera other = camera;
    other.model = FindModel(CameraModels(), model);
    other.params.insert(other.params.end(), more.begin(), more.end());
    return MicroLensGeometryOf(other);
  };
  EXPECT_EQ(with("focused-plenoptic-pupil", {0.02})->b_P, 0.02);
  EXPECT_EQ(with("plenoptic-thick", {50, 0, 0, 0, 0})->b_P, 1 / 50.0);
  EXPECT_EQ(with("focused-plenoptic-tilt", {0.01, -0.02})->tilt, Eigen::Vector2d(0.01, -0.02));
  EXPECT_FALSE(MicroLensGeometryOf(Ordinary()));
}

TEST_F(RecordFiles, ListStrongCorrelationsForTheReader) {
  EXPECT_THAT(CalibrationYaml(Record()), HasSubstr("- [left.f_x, left.f_y, 0.9700]"));
}

TEST_F(RecordFiles, OfGivenCamerasHoldParametersAlone) {
  const CalibrationRecord record = Record();
  const std::string text = GivenCamerasYaml(record.cameras, {{"source", "by hand"}});
  for (const char* key : {"sigma", "residuals", "frames", "adjustment", "vignetting"}) {
    EXPECT_THAT(text, ::testing::Not(HasSubstr(key)));
  }
  const CalibrationRecord again = ReadCalibration(Write("given.yaml", text), CameraModels());
  EXPECT_FALSE(again.adjustment);
  EXPECT_EQ(again.cameras[1].params, record.cameras[1].params);
  EXPECT_TRUE(again.cameras[1].covariance.isZero(0));
  EXPECT_EQ(again.provenance, Provenance({{"source", "by hand"}}));
}

TEST_F(RecordFiles, NeedOnlyWhatDescribesACamera) {
  const CalibrationRecord truth =
      ReadCalibration(Write("truth.yaml",
                            "plenocal: 1\ncameras:\n  a:\n    model: pinhole\n"
                            "    image_size: [640, 480]\n"
                            "    parameters: {f_x: 400, f_y: 401, c_x: 320, c_y: 240}\n"
                            "    T_camera_rig: [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], "
                            "[0, 0, 0, 1]]\n"
                            "    residuals: {points: 5, rms: 0.1, rejected: 0}\n"),
                      CameraModels());
  EXPECT_EQ(truth.cameras[0].params, std::vector<double>({400, 401, 320, 240}));
  EXPECT_EQ(truth.cameras[0].fit.points, 5);
}

TEST_F(RecordFiles, OfOlderVersionsNameUndeterminedParametersAlone) {
  CalibrationRecord record = Record();
  std::string text = CalibrationYaml(record);
  const size_t begin = text.find("weak:"), end = text.find("left_out:");
  text.replace(begin, end - begin, "warnings:\n  - \"old\"\n");
  text.erase(text.find("verdict:"), text.find("provenance:") - text.find("verdict:"));
  const CalibrationRecord again = ReadCalibration(Write("old.yaml", text), CameraModels());
  ASSERT_EQ(again.weak.size(), 1);
  EXPECT_TRUE(again.weak[0].open);
  EXPECT_THAT(again.weak[0].names, ElementsAre("left.A_2", "left.f_x"));
  EXPECT_FALSE(again.verdict);
  ASSERT_EQ(again.findings.size(), 1);
  EXPECT_EQ(again.findings[0].what, "old");
}

TEST_F(RecordFiles, NamePlaceAndKeyOfAMistake) {
  const std::string text = CalibrationYaml(Record());
  const auto message = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    changed.replace(changed.find(from), from.size(), to);
    const std::filesystem::path path = Write("calibration.yaml", changed);
    return testing::RefusalOf([&] { ReadCalibration(path, CameraModels()); });
  };
  EXPECT_THAT(message("pinhole-radial3", "pinhole-radail3"), HasSubstr("pinhole-radial3"));
  EXPECT_THAT(message("image_size: [640, 480]", "image_size: [640]"), HasSubstr(":5:"));
  EXPECT_THAT(message("image_circle: [310.5, 245, 280", "image_circle: [310.5, 245, 0"),
              AllOf(HasSubstr(":6:"), HasSubstr("positive radius")));
  EXPECT_THAT(message("image_circle: [310.5, 245, 280", "image_circle: [310.5, 2450, 280"),
              AllOf(HasSubstr(":6:"), HasSubstr("beside the image")));
  EXPECT_THAT(message("sigma_xi: [0.0001", "sigma_xi: [-0.0001"), HasSubstr("negative"));
  EXPECT_THAT(message("[0, 0, 0, 1]]", "[0, 0, 1, 1]]"), HasSubstr("T_camera_rig"));
  EXPECT_THAT(message("T_camera_rig: [[1,", "T_camera_rig: [[2,"), HasSubstr("no rotation"));
  EXPECT_THAT(message("rms_by_type: {0:", "rms_by_type: {first:"), HasSubstr("lens type"));
}

TEST_F(RecordFiles, KeepPosesOfFramesAndViews) {
  const CalibrationRecord record = Record();
  CalibrationRecord again = record;
  again.frames = ReadPoses(Write("poses.csv", PosesCsv(record)));
  ASSERT_EQ(again.frames.size(), 2);
  for (size_t f = 0; f < 2; ++f) {
    EXPECT_EQ(again.frames[f].name, record.frames[f].name);
    ExpectSame(again.frames[f].T_target_rig, record.frames[f].T_target_rig, kFileDigits);
  }
  for (CalibratedCamera& camera : again.cameras) camera.view_poses.clear();
  ReadViewPoses(Write("view_poses.csv", ViewPosesCsv(record)), &again);
  ASSERT_EQ(again.cameras[0].view_poses.size(), 2);
  EXPECT_TRUE(again.cameras[1].view_poses.empty());
  for (const auto& [frame, view] : record.cameras[0].view_poses) {
    const ViewPose& read = again.cameras[0].view_poses.at(frame);
    ExpectSame(read.T_target_rig, view.T_target_rig, kFileDigits);
    EXPECT_EQ(read.misplaced, view.misplaced);
    ExpectSame(again.CameraFromTarget(0, frame), view.T_target_rig.Inverse(), kFileDigits);
  }
  ExpectSame(again.CameraFromTarget(1, 1),
             record.cameras[1].T_camera_rig * record.frames[1].T_target_rig.Inverse(),
             kFileDigits);
}

TEST_F(RecordFiles, KeepResidualsOfCamerasWithDifferentColumns) {
  const CalibrationRecord record = Record();
  const std::string text = ResidualsCsv(record);
  EXPECT_THAT(text,
              ::testing::StartsWith("camera,frame,marker,x,y,dx,dy,used,lens_x,lens_y,noise_sigma\n"
                                    "left,0001,7,12.25,99,0.125,-0.5,1,,,0.1\n"
                                    "left,b,8,1,2,,,0,,,0.2\n"
                                    "plenoptic,b,7,1000.5,999,0.25,0.75,1,1001,1002.25,0.3\n"));
  CalibrationRecord again = record;
  for (CalibratedCamera& camera : again.cameras) camera.residuals.clear();
  ReadResiduals(Write("residuals.csv", text), &again);
  for (size_t c = 0; c < 2; ++c) {
    ASSERT_EQ(again.cameras[c].residuals.size(), record.cameras[c].residuals.size());
    for (size_t i = 0; i < record.cameras[c].residuals.size(); ++i) {
      const ResidualRow &a = record.cameras[c].residuals[i], &b = again.cameras[c].residuals[i];
      EXPECT_EQ(b.frame, a.frame);
      EXPECT_EQ(b.marker, a.marker);
      EXPECT_EQ(b.values, a.values);
      EXPECT_EQ(b.noise_sigma, a.noise_sigma);
      EXPECT_EQ(b.used, a.used);
      for (size_t k = 0; k < 2; ++k) {
        EXPECT_TRUE(b.residual[k] == a.residual[k] ||
                    (std::isnan(b.residual[k]) && std::isnan(a.residual[k])));
      }
    }
  }
}

TEST_F(RecordFiles, TakeTheNoiseSigmaOfOlderVersionsFromTheColumnSigma) {
  CalibrationRecord record = Record();
  record.cameras.pop_back();
  record.cameras[0].residuals.clear();
  ReadResiduals(Write("residuals.csv",
                      "camera,frame,marker,x,y,dx,dy,used,sigma\nleft,b,7,1,2,0.1,0.2,1,0.25\n"),
                &record);
  EXPECT_EQ(record.cameras[0].residuals.at(0).noise_sigma, 0.25);
}

TEST_F(RecordFiles, RefuseResidualsThatBelongToNothing) {
  const auto message = [&](const std::string& row) {
    CalibrationRecord record = Record();
    record.cameras.pop_back();
    const auto path =
        Write("residuals.csv", "camera,frame,marker,x,y,dx,dy,used,noise_sigma\n" + row + "\n");
    return testing::RefusalOf([&] { ReadResiduals(path, &record); });
  };
  EXPECT_THAT(message("right,b,7,1,2,0,0,1,1"), HasSubstr(":2:1: camera: 'right' is not in"));
  EXPECT_THAT(message("left,c,7,1,2,0,0,1,1"), HasSubstr(":2:6: frame: 'c' is not in"));
  EXPECT_THAT(message("left,b,9,1,2,0,0,1,1"), HasSubstr(":2:8: marker: 9 is not in"));
  EXPECT_THAT(message("left,b,7,1,2,,0,1,1"), HasSubstr(": dx: a used observation needs"));
  EXPECT_THAT(message("left,b,7,1,2"), HasSubstr(":2: expected 9 columns"));
}

TEST_F(RecordFiles, RefusePosesThatAreNone) {
  const auto message = [&](const std::string& rows) {
    const auto path = Write("poses.csv", "frame,x,y,z,qx,qy,qz,qw\n" + rows + "\n");
    return testing::RefusalOf([&] { ReadPoses(path); });
  };
  EXPECT_THAT(message("a,0,0,1,0,0,0,0.9"), HasSubstr(":2:9: qx: the quaternion has length 0.9"));
  EXPECT_THAT(message("a,0,0,1,0,0,0,1\na,0,0,1,0,0,0,1"), HasSubstr(":3:1: frame: 'a' stands"));
  EXPECT_THAT(message(",0,0,1,0,0,0,1"), HasSubstr(":2:1: frame: this frame's name is empty"));
}

TEST_F(RecordFiles, KeepTheMatrixOfCorrelations) {
  const Correlations written = Record().correlations;
  const std::string text = CorrelationsCsv(written);
  const Correlations read = ReadCorrelations(Write("correlations.csv", text));
  EXPECT_EQ(read.names, written.names);
  EXPECT_TRUE(read.matrix == written.matrix);
  const auto message = [&](const std::string& changed) {
    const auto path = Write("correlations.csv", changed);
    return testing::RefusalOf([&] { ReadCorrelations(path); });
  };
  EXPECT_THAT(message(text.substr(0, text.rfind("left.f_y"))), HasSubstr("fewer rows"));
  EXPECT_THAT(message(text + "left.c_x,0,0\n"), HasSubstr("more rows"));
  EXPECT_THAT(message("unknown,a,b\nb,1,0\na,0,1\n"), HasSubstr(":2:1: unknown: expected a, as"));
}

TEST_F(RecordFiles, RefuseCorrelationsThatAreNone) {
  const auto message = [&](const std::string& rows) {
    const auto path = Write("correlations.csv", "unknown,a,b,c\n" + rows);
    return testing::RefusalOf([&] { ReadCorrelations(path); });
  };
  // The limit of what three unknowns can have, with the digits that files have.
  EXPECT_EQ(message("a,1,0.333333333333,0.333333333333\n"
                    "b,0.333333333333,1,-0.777777777778\n"
                    "c,0.333333333333,-0.777777777778,1\n"),
            "no refusal");
  EXPECT_THAT(message("a,1,0,0\nb,0,1,1.5\nc,0,1.5,1\n"),
              HasSubstr("correlations.csv: the correlation of b and c is 1.5, which is not from"));
  EXPECT_THAT(message("a,1,0,0\nb,0,1,0.5\nc,0,0.4,1\n"),
              HasSubstr("the correlation of b and c is 0.5 in one place and 0.4 in the other"));
  EXPECT_THAT(message("a,1,0,0\nb,0,2,0\nc,0,0,1\n"),
              HasSubstr("the correlation of b and b is 2, not 1"));
  EXPECT_THAT(message("a,1,0.9,0.9\nb,0.9,1,-0.9\nc,0.9,-0.9,1\n"),
              HasSubstr("contradicts those with others"));
  EXPECT_THAT(message("a,1,0,0\nb,0,1,nan\nc,0,nan,1\n"), HasSubstr("expected a number"));
}

// What formulas behind the reader rely on.
TEST_F(RecordFiles, RefuseNumbersThatAreNoErrorsAndNoPoses) {
  const std::string text = CalibrationYaml(Record());
  const auto message = [&](const std::string& from, const std::string& to) {
    std::string changed = text;
    const size_t at = changed.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    changed.replace(at, from.size(), to);
    const auto path = Write("calibration.yaml", changed);
    return testing::RefusalOf([&] { ReadCalibration(path, CameraModels()); });
  };
  EXPECT_THAT(message("[0.97, 1]", "[1.5, 1]"),
              HasSubstr("correlation: the correlation of f_x and f_y is 1.5, which is not from"));
  EXPECT_THAT(message("[0.97, 1]", "[0.97, 0.5]"), HasSubstr("f_y and f_y is 0.5, not 1"));
  EXPECT_THAT(message("sigma: {f_x: 0.1,", "sigma: {f_x: -0.1,"), HasSubstr("found a negative"));
  EXPECT_THAT(message("sigma: {f_x: 0.1,", "sigma: {f_x: 1e200,"), HasSubstr("1e-150 to 1e150"));
  EXPECT_THAT(message("rms: 0.25", "rms: .inf"), HasSubstr("rms: expected a finite number"));
  EXPECT_THAT(message("rms: 0.25", "rms: -1"), HasSubstr("rms: expected a standard deviation"));
  EXPECT_THAT(message("points: 3", "points: -3"), HasSubstr("points: expected a number of at"));
  EXPECT_THAT(message("jitter: {translation: 0.001", "jitter: {translation: -1"),
              HasSubstr("jitter.translation: expected a standard deviation"));
  EXPECT_THAT(message("T_camera_rig: [[1,", "T_camera_rig: [[-1,"), HasSubstr("is no rotation"));
  EXPECT_THAT(message("T_camera_rig: [[1, 0, 0, 0]", "T_camera_rig: [[1, 0, 0, 1e300]"),
              HasSubstr("T_camera_rig: expected a translation in metres"));
}

TEST(JointCovariance, TakesCorrelationsBetweenCamerasByName) {
  CalibratedCamera a = Ordinary(), b = Ordinary();
  b.name = "right";
  b.sigma_xi.setConstant(0.01);
  const Correlations correlations{
      {"left.f_x", "right.f_x", "right.T_camera_rig.w_x"},
      (Eigen::Matrix3d() << 1, 0.5, 0, 0.5, 1, -0.25, 0, -0.25, 1).finished()};
  const Eigen::MatrixXd joint = JointCovariance({&a, &b}, correlations);
  const Eigen::Index one = 7 + 6;  // parameters and se(3) vector of a camera
  ASSERT_EQ(joint.rows(), 2 * one);
  EXPECT_DOUBLE_EQ(joint(0, one), 0.5 * 0.1 * 0.1);
  EXPECT_DOUBLE_EQ(joint(one, one + 7 + 3), -0.25 * 0.1 * 0.01);
  EXPECT_DOUBLE_EQ(joint(0, 1), a.covariance(0, 1)) << "a camera's own are in calibration.yaml";
  EXPECT_DOUBLE_EQ(joint(one + 7, one + 7), 1e-4);
  EXPECT_TRUE(joint == joint.transpose());
}

TEST_F(RecordFiles, RefuseValuesAtAndBeyondTheLimits) {
  const Param param{.name = "a", .unit = "px", .lower = -1, .upper = 2};
  const auto read = [&](const char* text) {
    return ReadWithin(YamlNode::Parse(fmt::format("a: {}\n", text), "c.yaml").At("a"), param);
  };
  EXPECT_EQ(read("-0.5"), -0.5);
  EXPECT_EQ(read("1.5"), 1.5);
  for (const char* text : {"-1", "2", "-3", "4"}) {
    EXPECT_THAT(testing::RefusalOf([&] { read(text); }), HasSubstr("is outside (-1, 2)")) << text;
  }
}

TEST(FindCamera, TakesTheOnlyOneWithoutAName) {
  CalibrationRecord record = Record();
  record.path = "c.yaml";
  EXPECT_EQ(FindCamera(record, "plenoptic").name, "plenoptic");
  EXPECT_THROW(FindCamera(record, ""), Error);
  EXPECT_THAT(
      testing::RefusalOf([&] { FindCamera(record, "plenoptik"); }),
      ::testing::AllOf(HasSubstr("c.yaml: no camera 'plenoptik'"), HasSubstr("'plenoptic'")));
  record.cameras.pop_back();
  EXPECT_EQ(FindCamera(record, "").name, "left");
}

}  // namespace TEST_FILE
}  // namespace plenocal
