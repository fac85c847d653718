// SPDX-License-Identifier: Apache-2.0
//
// Mistakes in session.yaml and target.yaml: each message names the place and says what to do.
#include <fmt/format.h>

#include "tests/apps/workspace.h"

namespace plenocal::testing {
namespace TEST_FILE {

struct Mistake {
  std::string name;  // of the test
  std::string file;
  std::string from, to;            // the edit of a good file that makes the mistake
  std::vector<std::string> parts;  // of the message
};

void PrintTo(const Mistake& mistake, std::ostream* out) { *out << mistake.name; }

// A wrong line in the session's first camera.
Mistake AddedToCamera(std::string name, const std::string& line, std::vector<std::string> parts) {
  return {
      std::move(name), "session.yaml", "options:", "    " + line + "\noptions:", std::move(parts)};
}

// A wrong entry of `distances`.
Mistake AddedDistance(std::string name, const std::string& entry, std::vector<std::string> parts) {
  return {std::move(name),
          "session.yaml",
          "cameras:",
          "distances: [" + entry + "]\ncameras:",
          std::move(parts)};
}

constexpr char kTags[] =
    "plenocal: 1\n"
    "type: apriltag\n"
    "family: tag36h11\n"
    "tags:\n"
    "  - {id: 0, corners: [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]}\n"
    "  - {id: 1, corners: [[0.2, 0, 0], [0.3, 0, 0], [0.3, 0.1, 0], [0.2, 0.1, 0]]}\n";

class WrongFile : public Workspace, public ::testing::WithParamInterface<Mistake> {};

TEST_P(WrongFile, IsRefusedWithPlaceAndRemedy) {
  const Mistake& mistake = GetParam();
  WriteProblem(EasyProblem());
  Write("tags.yaml", kTags);
  if (mistake.file == "tags.yaml") {
    Write("session.yaml", Replaced(Read("session.yaml"), "target.yaml", "tags.yaml"));
  }
  Write(mistake.file, Replaced(Read(mistake.file), mistake.from, mistake.to));
  ExpectFailure(kWrongInput, mistake.parts);
  ExpectFailure(kWrongInput, mistake.parts, "detect");
}

INSTANTIATE_TEST_SUITE_P(
    Session,
    WrongFile,
    ::testing::Values(
        Mistake{"UnknownKey",
                "session.yaml",
                "options:",
                "optoins:",
                {"session.yaml:8:", "optoins", "did you mean 'options'"}},
        Mistake{"UnknownCameraKey",
                "session.yaml",
                "image_size",
                "imagesize",
                {"session.yaml:7:", "cameras.cam0.imagesize", "did you mean 'image_size'"}},
        Mistake{"ImageCircleOfTwoNumbers",
                "session.yaml",
                "image_size",
                "image_circle: [300, 200]\n    image_size",
                {"session.yaml:7:", "cameras.cam0.image_circle", "[c_x, c_y, r_x, r_y]"}},
        Mistake{"UnknownOption",
                "session.yaml",
                "loss:",
                "los:",
                {"session.yaml:9:", "options.los", "did you mean 'loss'"}},
        Mistake{"UnknownModel",
                "session.yaml",
                "pinhole-radial3",
                "pinhole-radial",
                {"session.yaml:5:", "cameras.cam0.model", "did you mean 'pinhole-radial3'"}},
        Mistake{"PixelSizeInMillimetres",
                "session.yaml",
                "pinhole-radial3",
                "focused-plenoptic\n    pixel_size: 5.5e-3",
                {"session.yaml:6:", "cameras.cam0.pixel_size", "0.0055 m is outside"}},
        Mistake{"UnknownLoss",
                "session.yaml",
                "huber",
                "hubr",
                {"session.yaml:9:", "options.loss", "did you mean 'huber'"}},
        Mistake{"ParametersOfAnOpenModel",
                "session.yaml",
                "pinhole-radial3",
                "auto\n    initial: {f_x: 500}",
                {"session.yaml:6:", "cameras.cam0.initial", "in place of 'model: auto'"}},
        Mistake{"OpenModelBesideAnEarlierCalibration",
                "session.yaml",
                "options:",
                "from: target.yaml\noptions:\n  refine_target: auto",
                {"refine_target", "with 'from' none is chosen"}},
        AddedToCamera("UnknownParameter",
                      "initial: {fx: 500}",
                      {"session.yaml:8:", "'fx' is no parameter", "did you mean 'f_x'"}),
        AddedToCamera("UnknownFixedParameter",
                      "fixed: [A_9]",
                      {"session.yaml:8:", "fixed", "'A_9' is no parameter", "did you mean 'A_"}),
        AddedToCamera("FixedWithoutValue",
                      "fixed: [f_x]",
                      {"session.yaml:8:", "'f_x' is to be fixed", "'initial'"}),
        AddedToCamera("InitialOutsideItsBounds",
                      "initial: {f_x: -500}",
                      {"session.yaml:8:", "cameras.cam0.initial.f_x", "-500"}),
        AddedToCamera("InitialNan",
                      "initial: {f_x: .nan}",
                      {"session.yaml:8:", "cameras.cam0.initial.f_x", ".nan"}),
        AddedToCamera("InitialWithUnit",
                      "initial: {f_x: 500px}",
                      {"session.yaml:8:", "cameras.cam0.initial.f_x", "'500px'"}),
        AddedToCamera("PriorOfNoParameter",
                      "prior: {fx: {value: 500, sigma: 1}}",
                      {"session.yaml:8:", "'fx' is no parameter", "did you mean 'f_x'"}),
        AddedToCamera("PriorWithoutSigma",
                      "prior: {f_x: {value: 500}}",
                      {"session.yaml:8:", "prior.f_x", "sigma"}),
        AddedToCamera("PriorWithSigmaZero",
                      "prior: {f_x: {value: 500, sigma: 0}}",
                      {"session.yaml:8:", "prior.f_x.sigma", "0"}),
        AddedToCamera(
            "PriorOfAHeldParameter",
            "prior: {f_x: {value: 500, sigma: 1}}\n    initial: {f_x: 500}\n    fixed: [f_x]",
            {"session.yaml:8:", "prior.f_x", "'f_x' is fixed"}),
        AddedToCamera("BoundsUpsideDown",
                      "bounds: {A_0: [0.5, -0.5]}",
                      {"session.yaml:8:", "bounds.A_0", "lowest value first"}),
        AddedToCamera("BoundsOutsideTheModelsLimits",
                      "bounds: {f_x: [-5, 1000]}",
                      {"session.yaml:8:", "bounds.f_x", "f_x = -5 px is outside"}),
        AddedToCamera("StartOutsideTheBounds",
                      "bounds: {f_x: [600, 700]}\n    initial: {f_x: 500}",
                      {"session.yaml:8:", "bounds.f_x", "'initial'", "500", "[600, 700]"}),
        AddedToCamera("EqualOfDifferentUnits",
                      "equal: [[f_x, A_0]]",
                      {"session.yaml:8:", "equal", "'A_0' (1)", "'f_x' (px)"}),
        AddedToCamera("EqualOfOne",
                      "equal: [[f_x]]",
                      {"session.yaml:8:", "equal[0]", "two parameters"}),
        AddedToCamera("EqualWithDifferentStarts",
                      "equal: [[f_x, f_y]]\n    initial: {f_x: 500, f_y: 510}",
                      {"session.yaml:8:", "'initial' of 'f_y' is 510", "'f_x'", "500"}),
        AddedToCamera("BoundsOfAnEqualParameter",
                      "equal: [[f_x, f_y]]\n    bounds: {f_y: [400, 600]}",
                      {"session.yaml:8:", "give prior and bounds to 'f_x'"}),
        AddedToCamera("SharedWithNoCamera",
                      "shared: {f_x: left}",
                      {"session.yaml:8:", "shared.f_x", "another camera", "'left'"}),
        AddedToCamera("SharedWithItself",
                      "shared: {f_x: cam0}",
                      {"session.yaml:8:", "shared.f_x", "another camera"}),
        AddedDistance("DistanceOfNoMarker",
                      "{between: [marker 0, marker 900], length: 0.3, sigma: 0.001}",
                      {"session.yaml:3:", "between[0]", "the target has no marker 900"}),
        AddedDistance("DistanceOfATagOnABoard",
                      "{between: [tag 0, tag 1], length: 0.3, sigma: 0.001}",
                      {"session.yaml:3:", "the target has no tag 0"}),
        AddedDistance("DistanceOfOneMarker",
                      "{between: [marker 0, marker 0], length: 0.3, sigma: 0.001}",
                      {"session.yaml:3:", "between[1]", "is the same point"}),
        AddedDistance("DistanceOfLengthZero",
                      "{between: [marker 0, marker 5], length: 0, sigma: 0.001}",
                      {"session.yaml:3:", "distances[0].length"}),
        AddedDistance("DistanceOfNegativeLength",
                      "{between: [marker 0, marker 5], length: -0.3, sigma: 0.001}",
                      {"session.yaml:3:", "distances[0].length"}),
        AddedDistance("DistanceBetweenOthers",
                      "{between: [point 0, marker 5], length: 0.3, sigma: 0.001}",
                      {"session.yaml:3:", "'marker NUMBER'", "got 'point 0'"}),
        AddedDistance("DistanceOfATargetByName",
                      "{between: ['wall: marker 0', marker 5], length: 0.3, sigma: 0.001}",
                      {"session.yaml:3:", "the only target needs no name"}),
        Mistake{"ScaleSigmaOfWrongShape",
                "target.yaml",
                "type:",
                "scale_sigma: [0.001]\ntype:",
                {"target.yaml:", "scale_sigma", "[x, y]"}},
        Mistake{"ScaleSigmaOfZero",
                "target.yaml",
                "type:",
                "scale_sigma: 0\ntype:",
                {"target.yaml:", "scale_sigma", "above 0 and below 1"}},
        Mistake{"ScaleSigmaInPercent",
                "target.yaml",
                "type:",
                "scale_sigma: [0.001, 1.5]\ntype:",
                {"target.yaml:", "scale_sigma[1]", "above 0 and below 1"}},
        Mistake{"WrongType",
                "session.yaml",
                "[1280, 960]",
                "1280x960",
                {"session.yaml:7:", "cameras.cam0.image_size", "1280x960"}},
        Mistake{"NegativeImageSize",
                "session.yaml",
                "[1280, 960]",
                "[1280, -960]",
                {"session.yaml:7:", "cameras.cam0.image_size[1]", "positive"}},
        Mistake{"NanImageSize",
                "session.yaml",
                "[1280, 960]",
                "[.nan, 960]",
                {"session.yaml:7:", "cameras.cam0.image_size[0]", ".nan"}},
        Mistake{"DetectionsWithoutImageSize",
                "session.yaml",
                "    image_size: [1280, 960]\n",
                "",
                {"session.yaml:5:", "cameras.cam0", "image_size: [width, height]"}},
        Mistake{"DuplicateCamera",
                "session.yaml",
                "options:",
                "  cam0:\n    model: pinhole-radial3\noptions:",
                {"session.yaml:8:", "cameras.cam0", "line 4", "remove one"}},
        Mistake{"DuplicateKey",
                "session.yaml",
                "  loss: huber",
                "  loss: huber\n  loss: none",
                {"session.yaml:10:", "options.loss", "line 9"}},
        Mistake{"NoImagesNoDetections",
                "session.yaml",
                "    detections: cam0.csv\n",
                "",
                {"session.yaml:5:", "cameras.cam0", "'images'", "'detections'"}},
        Mistake{"SeveralKeysMissingOfACamera",
                "session.yaml",
                "    model: pinhole-radial3\n    detections: cam0.csv\n",
                "",
                {"session.yaml:5:", "cam0: these keys are missing: model, images", "'model: "}},
        Mistake{
            "WordWithoutItsSquare",
            "session.yaml",
            "target.yaml",
            "chessboard:10x7",
            {"session.yaml:2:", "target: chessboard:10x7: 'square' is missing", "COLUMNSxROWS"}},
        Mistake{"WordWithAnUnknownType",
                "session.yaml",
                "target.yaml",
                "chesboard:10x7:30mm",
                {"session.yaml:2:", "chesboard", "did you mean 'chessboard'"}},
        Mistake{"InlineTargetWithAnUnknownKey",
                "session.yaml",
                "target: target.yaml",
                "target: {type: chessboard, columns: 10, rows: 7, sqare: 30 mm}",
                {"session.yaml:2:", "target.sqare", "did you mean 'square'"}},
        Mistake{"ExcludeOfNoCamera",
                "session.yaml",
                "options:",
                "exclude: [{camera: cam1, frame: a}]\noptions:",
                {"session.yaml:8:", "exclude[0].camera", "did you mean 'cam0'"}},
        Mistake{"ExcludeOfNothing",
                "session.yaml",
                "options:",
                "exclude: [{note: bad}]\noptions:",
                {"session.yaml:8:", "exclude[0]", "'frame'", "'markers'"}},
        Mistake{"PluginThatIsNotThere",
                "session.yaml",
                "options:",
                "plugins: [libmine.so]\noptions:",
                {"session.yaml:8:", "plugins[0]", "libmine.so", "no such file"}},
        Mistake{"NoCameras",
                "session.yaml",
                "  cam0:\n    model: pinhole-radial3\n    detections: cam0.csv\n"
                "    image_size: [1280, 960]\n",
                "  {}\n",
                {"session.yaml:4:", "cameras", "at least one camera"}},
        Mistake{"CameraNameThatIsNoFileName",
                "session.yaml",
                "cam0:",
                "../cam0:",
                {"session.yaml:5:", "file names"}},
        Mistake{
            "NoVersion", "session.yaml", "plenocal: 1\n", "", {"session.yaml:1:", "plenocal: 1"}},
        Mistake{"OtherVersion",
                "session.yaml",
                "plenocal: 1\n",
                "plenocal: 2\n",
                {"session.yaml:1:", "version"}},
        Mistake{"NoYaml", "session.yaml", "cameras:", "cameras: [", {"session.yaml:"}},
        Mistake{"MissingTarget",
                "session.yaml",
                "target.yaml",
                "tagret.yaml",
                {"tagret.yaml", "o such file"}},
        Mistake{"MissingDetections",
                "session.yaml",
                "cam0.csv",
                "cam00.csv",
                {"cam00.csv", "o such file"}},
        Mistake{"EmptyGlob",
                "session.yaml",
                "detections: cam0.csv",
                "images: left/*.png",
                {"cam0: images", "left/*.png", "no file matches", "check the path"}}),
    [](const auto& test) { return test.param.name; });

INSTANTIATE_TEST_SUITE_P(
    Target,
    WrongFile,
    ::testing::Values(
        Mistake{"UnknownType",
                "target.yaml",
                "chessboard",
                "chesboard",
                {"target.yaml:2:", "type", "did you mean 'chessboard'"}},
        Mistake{"UnknownKey",
                "target.yaml",
                "columns",
                "colums",
                {"target.yaml:3:", "colums", "did you mean 'columns'"}},
        Mistake{"UnknownUnit",
                "target.yaml",
                "0.03",
                "30 ft",
                {"target.yaml:5:", "square", "metres", "'30 ft'", "50 mm"}},
        Mistake{"SquareInMillimetres",
                "target.yaml",
                "0.03",
                "30",
                {"target.yaml:5:", "square: 30 m? if millimetres are meant, write 30 mm"}},
        Mistake{"SquareScaledTwice",
                "target.yaml",
                "0.03",
                "0.00003",
                {"target.yaml:5:", "square: 0.00003 m", "30 mm are meant, write 30 mm"}},
        Mistake{"SeveralKeysMissing",
                "target.yaml",
                "columns: 10\nrows: 7\nsquare: 0.03\n",
                "",
                {"target.yaml:1:",
                 "these keys are missing: columns, rows, square",
                 "'columns: 6', 'rows: 5', 'square: 0.03'"}},
        Mistake{"NanSize", "target.yaml", "0.03", ".nan", {"target.yaml:5:", "square", ".nan"}},
        Mistake{"NegativeSize",
                "target.yaml",
                "0.03",
                "-0.03",
                {"target.yaml:5:", "square", "-0.03", "above 0"}},
        Mistake{"WrongType",
                "target.yaml",
                "columns: 10",
                "columns: ten",
                {"target.yaml:3:", "columns", "'ten'"}},
        Mistake{"DuplicateKey",
                "target.yaml",
                "rows: 7",
                "rows: 7\nrows: 8",
                {"target.yaml:5:", "rows", "line 4"}},
        Mistake{"DuplicateTag",
                "tags.yaml",
                "id: 1",
                "id: 0",
                {"tags.yaml:6:", "tags[1].id", "tag 0", "line 5", "own id"}},
        Mistake{"UnknownFamily",
                "tags.yaml",
                "tag36h11",
                "tg36h11",
                {"tags.yaml:3:", "family", "did you mean 'tag36h11'"}},
        Mistake{"NanCorner",
                "tags.yaml",
                "[0.2, 0, 0]",
                "[.nan, 0, 0]",
                {"tags.yaml:6:", "tags[1].corners[0]", ".nan"}}),
    [](const auto& test) { return test.param.name; });

class SessionFile : public Workspace {};

TEST_F(SessionFile, NamesAnImageCircleBesideTheImage) {
  WriteProblem(EasyProblem());
  const std::string session = Read("session.yaml");
  for (const char* circle : {"[9000, 9000, 300, 200]", "[300, 200, 5, 5]"}) {
    Write("session.yaml",
          Replaced(session, "image_size", fmt::format("image_circle: {}\n    image_size", circle)));
    ExpectFailure(kWrongInput, {"cam0", "image_circle", "beside the image"});
  }
}

TEST_F(SessionFile, ThatIsMissingIsNamed) {
  ExpectFailure(kWrongInput, {"session.yaml", "o such file"});
}

TEST_F(SessionFile, ThatIsAFolderIsNamed) {
  std::filesystem::create_directory(Path("session.yaml"));
  ExpectFailure(kWrongInput, {"session.yaml"});
}

TEST_F(SessionFile, ThatIsEmptyIsNamed) {
  Write("session.yaml", "");
  ExpectFailure(kWrongInput, {"session.yaml", "empty", "plenocal: 1"});
}

TEST_F(SessionFile, MayLieInAnotherFolderThanTheWorkingOne) {
  WriteProblem(EasyProblem());
  std::filesystem::create_directory(Path("below"));
  for (const char* name : {"session.yaml", "target.yaml", "cam0.csv"}) {
    std::filesystem::rename(Path(name), Path("below") / name);
  }
  const Outcome outcome = Run({"calibrate", "below/session.yaml", "-o", "out"});
  EXPECT_EQ(outcome.status, kDone) << outcome.err;
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
