// SPDX-License-Identifier: Apache-2.0
//
// Cameras given by detections: mistakes in the CSV, and data that do not suffice.
#include <fmt/format.h>

#include <random>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

using ::testing::HasSubstr;

struct CsvMistake {
  std::string name;
  std::string text;
  std::vector<std::string> parts;
};

void PrintTo(const CsvMistake& mistake, std::ostream* out) { *out << mistake.name; }

// In what follows a good header.
CsvMistake InRows(std::string name, const std::string& rows, std::vector<std::string> parts) {
  return {std::move(name), "frame,marker,x,y\n" + rows, std::move(parts)};
}

class WrongDetections : public Workspace, public ::testing::WithParamInterface<CsvMistake> {};

TEST_P(WrongDetections, AreRefusedWithPlaceAndRemedy) {
  WriteProblem(EasyProblem());
  Write("cam0.csv", GetParam().text);
  ExpectFailure(kWrongInput, GetParam().parts);
}

INSTANTIATE_TEST_SUITE_P(
    Csv,
    WrongDetections,
    ::testing::Values(
        CsvMistake{"Empty", "", {"cam0.csv:1:", "header line", "frame,marker,x,y"}},
        CsvMistake{"MissingColumn",
                   "frame,marker,x,sigma\n0,1,2,3\n",
                   {"cam0.csv:1:", "column 'y' is missing", "frame,marker,x,y"}},
        CsvMistake{"ColumnTwice",
                   "frame,marker,x,x,y\n0,1,2,3,4\n",
                   {"cam0.csv:1:", "column 'x'", "twice"}},
        InRows("BadNumber",
               "0,1,2,3\n0,2,2.5px,3\n",
               {"cam0.csv:3:", "x: expected a number", "'2.5px'"}),
        InRows("EmptyNumber", "0,1,2,\n", {"cam0.csv:2:", "y: expected a number"}),
        InRows("Nan", "0,1,2,nan\n", {"cam0.csv:2:", "y: expected a number", "'nan'"}),
        InRows("Infinity", "0,1,inf,2\n", {"cam0.csv:2:", "x: expected a number", "'inf'"}),
        InRows("BadMarker",
               "0,one,2,3\n",
               {"cam0.csv:2:", "marker: expected a whole number", "'one'"}),
        CsvMistake{"NegativeSigma",
                   "frame,marker,x,y,sigma\n0,1,2,3,-0.1\n",
                   {"cam0.csv:2:", "sigma: expected a positive number", "'-0.1'"}},
        InRows("NoFrame", ",1,2,3\n", {"cam0.csv:2:", "frame:"}),
        CsvMistake{"TruncatedLastRow",
                   "frame,marker,x,y,sigma\n0,1,2,3,0.1\n0,2,5",
                   {"cam0.csv:3:", "expected 5 columns", "found 3", "truncated"}},
        InRows("DuplicateMarker",
               "0,1,2,3\n1,1,2,3\n0,2,2,3\n0,1,4,3\n",
               {"cam0.csv:5:", "frame '0'", "marker 1", "line 2", "keep one"})),
    [](const auto& test) { return test.param.name; });

class Detections : public Workspace {
 protected:
  void WriteAndExpectFailure(const SyntheticProblem& problem,
                             const std::vector<std::string>& parts) const {
    WriteProblem(problem);
    ExpectFailure(kJobFailed, parts);
  }

  // Fails, or says what is not determined; never a figure that looks well known.
  void ExpectHonest(const SyntheticProblem& problem) const {
    WriteProblem(problem);
    const Outcome outcome = Run({"calibrate", "session.yaml", "-o", "out"});
    if (outcome.status == kJobFailed) {
      EXPECT_THAT(outcome.err, HasSubstr("cam0"));
      return;
    }
    EXPECT_EQ(outcome.status, kDone) << outcome.err;
    ExpectUndetermined(outcome);
  }

  void ExpectUndetermined(const Outcome& outcome) const {
    EXPECT_THAT(outcome.out, HasSubstr("[undetermined]"));
    EXPECT_THAT(outcome.out, ::testing::Not(HasSubstr("nan")));
    ExpectNoNan(Result());
    EXPECT_GT(Result()["undetermined"].size(), 0U);
  }
};

TEST_F(Detections, WithOnlyAHeaderAreNotEnough) {
  SyntheticProblem problem = EasyProblem();
  problem.input.cameras[0].views.clear();
  WriteAndExpectFailure(problem, {"cam0", "no image shows 4 or more markers"});
}

TEST_F(Detections, WithoutSigmaOrInAnotherOrderOfColumnsAreRead) {
  const SyntheticProblem problem = EasyProblem();
  WriteProblem(problem);
  std::string text = "\xEF\xBB\xBFmarker, y, x, frame, note\r\n";
  for (const View& view : problem.input.cameras[0].views) {
    for (const Observation& o : view.observations) {
      text += fmt::format("{}, {}, {}, {}, -\r\n", o.marker, o.values[1], o.values[0], view.frame);
    }
  }
  Write("cam0.csv", text);
  Calibrate();
  EXPECT_NEAR(Result()["cameras"]["cam0"]["parameters"]["f_x"].as<double>(),
              problem.params[0][0],
              0.01 * problem.params[0][0]);
}

TEST_F(Detections, OfUnknownMarkersAreReportedAndLeftOut) {
  WriteProblem(EasyProblem());
  Write("cam0.csv", Read("cam0.csv") + "0000,4711,100,100,0.1\n");
  const Outcome outcome = Calibrate();
  EXPECT_THAT(outcome.err,
              HasSubstr("left out cam0 frame 0000 marker 4711: the target has no such"));
  EXPECT_THAT(Read("out/calibration.yaml"), HasSubstr("marker 4711"));
  EXPECT_THAT(Read("out/residuals.csv"), ::testing::Not(HasSubstr(",4711,")));
}

TEST_F(Detections, OfOnlyUnknownMarkersAreNotEnough) {
  SyntheticProblem problem = EasyProblem();
  for (View& view : problem.input.cameras[0].views) {
    for (Observation& o : view.observations) o.marker += 1000;
  }
  WriteAndExpectFailure(problem, {"cam0", "4 or more markers of the target"});
}

TEST_F(Detections, OfThreeMarkersAFrameAreNotEnough) {
  SyntheticProblem problem = EasyProblem();
  for (View& view : problem.input.cameras[0].views) view.observations.resize(3);
  WriteAndExpectFailure(problem, {"cam0", "4 or more markers"});
}

// One view of a plane by this camera is a homography, 8 figures for 10 unknowns. (A distorted view
// determines more: the centre of the distortion.)
SyntheticProblem UndistortedProblem() {
  return MakeProblem(3, {.frames = 10, .noise = 0.1, .distorted = false});
}

void ShowFourPointsOnce(SyntheticProblem* problem) {
  std::vector<View>& views = problem->input.cameras[0].views;
  views.resize(1);
  std::erase_if(views[0].observations, [](const Observation& o) {
    return o.marker != 0 && o.marker != 9 && o.marker != 60 && o.marker != 69;
  });
}

TEST_F(Detections, OfOneViewOfFourPointsDoNotDetermineACamera) {
  SyntheticProblem problem = EasyProblem();
  ShowFourPointsOnce(&problem);
  ExpectHonest(problem);
}

// The fit is exact, so that the noise is not estimated.
TEST_F(Detections, OfOneViewOfFourPointsLeaveTheMarkersAtTheirTolerance) {
  SyntheticProblem problem = EasyProblem(1, 0.0005);
  ShowFourPointsOnce(&problem);
  WriteProblem(problem);
  Calibrate();
  EXPECT_NEAR(Result()["cameras"]["cam0"]["residuals"]["noise"].as<double>(), 0.1, 1e-6);
  for (const auto& marker : YAML::LoadFile(Path("out/target.yaml"))["sigma"]) {
    for (const auto& sigma : marker.second) {
      EXPECT_GT(sigma.as<double>(), 0.0003) << marker.first;
      EXPECT_LT(sigma.as<double>(), 0.000501) << marker.first;
    }
  }
}

TEST_F(Detections, OfOneViewOfAPlaneDoNotDetermineACamera) {
  SyntheticProblem problem = UndistortedProblem();
  problem.input.cameras[0].views.resize(1);
  ExpectHonest(problem);
}

TEST_F(Detections, OfAllFramesFromOnePoseAreNamedAsUndetermined) {
  SyntheticProblem problem = UndistortedProblem();
  std::vector<View>& views = problem.input.cameras[0].views;
  std::mt19937 random(7);
  std::normal_distribution<double> noise(0, 0.1);
  for (View& view : views) {
    view.observations = views[0].observations;
    for (Observation& o : view.observations) {
      o.values[0] += noise(random);
      o.values[1] += noise(random);
    }
  }
  WriteProblem(problem);
  const Outcome outcome = Calibrate();
  ExpectUndetermined(outcome);
  EXPECT_THAT(outcome.out, HasSubstr("cam0.f_"));
}

TEST_F(Detections, OfCamerasWithoutACommonFrameCannotBeJoined) {
  SyntheticProblem problem = EasyProblem(2);
  for (View& view : problem.input.cameras[1].views) view.frame = "other" + view.frame;
  WriteAndExpectFailure(problem, {"no frame", "cam0", "cam1", "matched by name"});
}

TEST_F(Detections, OfChainedCamerasAreJoined) {
  SyntheticProblem problem = EasyProblem(3);
  auto& cameras = problem.input.cameras;
  // cam0 with cam1 in even frames, cam1 with cam2 in odd ones.
  const auto keep = [](std::vector<View>* views, int odd) {
    std::erase_if(*views, [odd](const View& view) { return std::stoi(view.frame) % 2 != odd; });
  };
  keep(&cameras[0].views, 0);
  keep(&cameras[2].views, 1);
  WriteProblem(problem);
  Calibrate();
  const YAML::Node result = Result()["cameras"];
  for (int c = 1; c < 3; ++c) {
    const Eigen::Matrix4d T = Matrix(result[fmt::format("cam{}", c)]["T_camera_rig"]);
    const RigidTransform& truth = problem.T_camera_rig[static_cast<std::size_t>(c)];
    EXPECT_LT((T.topRightCorner<3, 1>() - truth.t).norm(), 0.01 * truth.t.norm());
    EXPECT_LT((T.topLeftCorner<3, 3>() - truth.R).norm(), 5e-3);
  }
}

TEST_F(Detections, OfTheMasterMayBeMissingInSomeFrames) {
  SyntheticProblem problem = EasyProblem(2);
  problem.input.cameras[0].views.erase(problem.input.cameras[0].views.begin(),
                                       problem.input.cameras[0].views.begin() + 4);
  WriteProblem(problem);
  Calibrate();
  EXPECT_EQ(Result()["frames"].as<int>(), 10);
  EXPECT_EQ(Table(Read("out/poses.csv")).Rows(), 10U);
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
