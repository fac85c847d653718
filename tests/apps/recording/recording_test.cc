// SPDX-License-Identifier: Apache-2.0
#include "engine/recording/recording.h"

#include <cmath>
#include <functional>

#include "calib/base/error.h"
#include "engine/recording/recording_summary.h"
#include "engine/recording/supplied_detections.h"
#include "models/registry.h"
#include "tests/apps/recording/small_images.h"
#include "tests/apps/workspace.h"
#include "tests/optional_data.h"

namespace plenocal::testing {
namespace TEST_FILE {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::StartsWith;

constexpr int kFrames = 6;
constexpr double kInterval = 0.1;  // s
double TimeOf(int frame) { return 1000 + kInterval * frame; }
int GreyOf(int camera, int frame) { return 100 * camera + 10 * frame + 5; }

/// What a recording is, without names: times, and the grey values of the images of each frame.
struct Shown {
  double time;
  std::vector<int> grey;  // per camera, -1: no image
};

std::vector<Shown> ShownBy(const Recording& recording) {
  std::vector<Shown> shown;
  for (const RecordedFrame& frame : recording.frames) {
    Shown& instant = shown.emplace_back(Shown{frame.time, {}});
    for (size_t c = 0; c < recording.cameras.size(); ++c) {
      instant.grey.push_back(
          frame.image[c] ? recording.cameras[c].Read(*frame.image[c]).at<unsigned char>(0, 0) : -1);
    }
  }
  return shown;
}

class Recordings : public Workspace {
 protected:
  void WriteFile(const std::string& name, const std::string& content) const {
    fs::create_directories(Path(name).parent_path());
    Write(name, content);
  }

  void WriteImages(const std::string& folder, int camera, const std::string& prefix = "") const {
    for (int i = 0; i < kFrames; ++i) {
      WriteFile(fmt::format("{}/{}{:04}.pgm", folder, prefix, i + 1), FlatImage(GreyOf(camera, i)));
    }
  }

  /// TUM's lines; `prefix` of the images' names.
  static std::string TimesText(const std::string& exposure = " 2.5") {
    std::string text;
    for (int i = 0; i < kFrames; ++i) {
      text += fmt::format("{:04} {:.6f}{}\n", i + 1, TimeOf(i), exposure);
    }
    return text;
  }

  void WriteEuroc(const std::string& folder, int camera) const {
    std::string csv = "#timestamp [ns],filename\n";
    for (int i = 0; i < kFrames; ++i) {
      const std::string stamp = fmt::format("{:.0f}", TimeOf(i) * 1e9);
      csv += fmt::format("{0},{0}.pgm\n", stamp);
      WriteFile(fmt::format("{}/data/{}.pgm", folder, stamp), FlatImage(GreyOf(camera, i)));
    }
    WriteFile(folder + "/data.csv", csv);
  }

  [[nodiscard]] Recording Read(const std::string& name) const { return ReadRecording(Path(name)); }

  /// All frames with images of so many cameras.
  void ExpectAllFrames(const std::string& name, int cameras, const std::string& layout) const {
    SCOPED_TRACE(name);
    const Recording recording = Read(name);
    EXPECT_EQ(recording.layout, layout);
    EXPECT_THAT(recording.left_out, ::testing::IsEmpty());
    const std::vector<Shown> shown = ShownBy(recording);
    ASSERT_EQ(shown.size(), static_cast<size_t>(kFrames));
    for (int i = 0; i < kFrames; ++i) {
      constexpr double kRounding = 1e-6;  // s: EuRoC's nanoseconds since 1970 in a double
      EXPECT_NEAR(shown[i].time, TimeOf(i), kRounding);
      std::vector<int> grey;
      for (int c = 0; c < cameras; ++c) grey.push_back(GreyOf(c, i));
      EXPECT_EQ(shown[i].grey, grey);
    }
  }

  /// The message of the refusal; fails when there is none, or it is not for bad input.
  [[nodiscard]] std::string Refusal(const std::string& name) const {
    try {
      static_cast<void>(Read(name));
    } catch (const Error& error) {
      EXPECT_EQ(error.kind(), ErrorKind::kInput);
      return error.what();
    }
    ADD_FAILURE() << name << " was read";
    return {};
  }
};

TEST_F(Recordings, OfAllLayoutsHaveTheSameFrames) {
  WriteImages("tum/images", 0);
  WriteFile("tum/times.txt", TimesText());
  WriteImages("kitti/image_0", 0);
  WriteImages("kitti/image_1", 1);
  std::string kitti;
  for (int i = 0; i < kFrames; ++i) kitti += fmt::format("{:e}\n", TimeOf(i));
  WriteFile("kitti/times.txt", kitti);
  WriteEuroc("euroc/mav0/cam0", 0);
  WriteEuroc("euroc/mav0/cam1", 1);
  WriteImages("folders/left", 0);
  WriteImages("folders/right", 1);
  WriteFile("folders/times.txt", TimesText());
  WriteImages("own/a", 0, "l");
  WriteImages("own/b", 1, "r");
  WriteFile("own/t.txt", TimesText(""));
  WriteFile("own/recording.yaml",
            "plenocal: 1\ncameras:\n  left: {images: a/l*.pgm, times: t.txt}\n"
            "  right: {images: b/r*.pgm, times: t.txt}\n");

  ExpectAllFrames("tum", 1, "TUM monoVO");
  ExpectAllFrames("kitti", 2, "KITTI");
  ExpectAllFrames("euroc", 2, "EuRoC");
  ExpectAllFrames("euroc/mav0", 2, "EuRoC");
  ExpectAllFrames("folders", 2, "folders");
  ExpectAllFrames("own", 2, "recording.yaml");
  ExpectAllFrames("own/recording.yaml", 2, "recording.yaml");
  EXPECT_EQ(Read("own").frames[0].name, "0001");
}

TEST_F(Recordings, ReadArchivesInPlace) {
  std::map<std::string, std::string> left, both;
  for (int i = 0; i < kFrames; ++i) {
    const std::string name = fmt::format("{:04}.pgm", i + 1);
    left[name] = FlatImage(GreyOf(0, i));
    both["set/left/" + name] = FlatImage(GreyOf(0, i));
    both["set/right/" + name] = FlatImage(GreyOf(1, i));
  }
  left["__MACOSX/._0001.pgm"] = "not an image";
  left["readme.txt"] = "not an image either";
  fs::create_directories(Path("tum"));
  WriteZip(Path("tum/images.zip"), left);
  WriteFile("tum/times.txt", TimesText());
  ExpectAllFrames("tum", 1, "TUM monoVO");

  WriteZip(Path("both.zip"), both);
  WriteFile("times.txt", TimesText());
  WriteFile("recording.yaml",
            "plenocal: 1\ncameras:\n  left: {images: both.zip/set/left, times: times.txt}\n"
            "  right: {images: both.zip/set/right, times: times.txt}\n");
  ExpectAllFrames("recording.yaml", 2, "recording.yaml");

  const Recording found = Read("both.zip");
  ASSERT_EQ(found.cameras.size(), 2U);
  EXPECT_EQ(found.cameras[1].name, "right");
  EXPECT_EQ(ShownBy(found)[3].grey, std::vector<int>({GreyOf(0, 3), GreyOf(1, 3)}));
  EXPECT_THAT(found.cameras[1].images[0].path.string(), HasSubstr("both.zip/set/right/0001.pgm"));

  WriteFile("recording.yaml", "plenocal: 1\ncameras: {left: {images: both.zip}}\n");
  EXPECT_THAT(Refusal("recording.yaml"), HasSubstr("archive.zip/left"));
}

TEST_F(Recordings, PairByTimeImagesThatAreNearestToEachOther) {
  constexpr int kMissing = 2;  // the right camera lacks it, so its numbers run apart
  std::string left, right;
  for (int i = 0, number = 0; i < kFrames; ++i) {
    WriteFile(fmt::format("left/{:03}.pgm", i), FlatImage(GreyOf(0, i)));
    left += fmt::format("{:03} {}\n", i, TimeOf(i));
    if (i == kMissing) continue;
    WriteFile(fmt::format("right/{:03}.pgm", number), FlatImage(GreyOf(1, i)));
    right += fmt::format("{:03} {}\n", number++, TimeOf(i) + 0.02 * kInterval);
  }
  WriteFile("times_left.txt", left);
  WriteFile("times_right.txt", right);
  const Recording recording = Read("");
  EXPECT_EQ(recording.paired_by, Pairing::By::kTime);
  const std::vector<Shown> shown = ShownBy(recording);
  ASSERT_EQ(shown.size(), static_cast<size_t>(kFrames));
  for (int i = 0; i < kFrames; ++i) {
    EXPECT_THAT(shown[i].grey, ElementsAre(GreyOf(0, i), i == kMissing ? -1 : GreyOf(1, i)));
  }
  const RecordingSummary summary = Summarise(recording, CameraModels());
  ASSERT_EQ(summary.pairs.size(), 1U);
  EXPECT_EQ(summary.pairs[0].frames, static_cast<size_t>(kFrames - 1));
  EXPECT_NEAR(summary.pairs[0].largest, 0.02 * kInterval, 1e-9);
  EXPECT_EQ(summary.cameras[0].Missing(), 0U);
  ASSERT_EQ(summary.cameras[1].gaps->size(), 1U);
  EXPECT_EQ(summary.cameras[1].gaps->front().after, "001");
  EXPECT_NEAR(summary.rate, 1 / kInterval, 1e-6);

  // By a tolerance that is less than the difference nothing is a pair; all names are unique.
  WriteFile("recording.yaml",
            "plenocal: 1\ncameras:\n  left: {images: left, times: times_left.txt}\n"
            "  right: {images: right, times: times_right.txt}\n"
            "pairing: {by: time, tolerance: 0.0001}\n");
  const Recording apart = Read("");
  EXPECT_EQ(apart.frames.size(), static_cast<size_t>(2 * kFrames - 1));
  std::set<std::string> names;
  for (const RecordedFrame& frame : apart.frames) names.insert(frame.name);
  EXPECT_EQ(names.size(), apart.frames.size());
}

TEST_F(Recordings, FillExposuresThatAreNotGiven) {
  WriteImages("images", 0);
  WriteFile("times.txt", "0001 1 0\n0002 2 4\n0003 3\n0004 4 0\n0005 5 8\n0006 6 10\n");
  const RecordedCamera camera = Read("").cameras[0];
  std::vector<double> exposures;
  for (const RecordedImage& image : camera.images) exposures.push_back(*image.exposure);
  EXPECT_THAT(exposures, ElementsAre(4, 4, 6, 6, 8, 10));
  EXPECT_EQ(camera.exposures_filled, 3U);

  WriteFile("recording.yaml",
            "plenocal: 1\ncameras: {cam: {images: images, times: times.txt, exposure_unit: us}}\n");
  EXPECT_DOUBLE_EQ(*Read("").cameras[0].images[5].exposure, 0.01);
}

TEST_F(Recordings, LeaveOutWhatCannotBeUsedAndCountIt) {
  WriteImages("images", 0);
  WriteFile("images/0003.pgm", FlatImage(1, 8, 8));
  WriteFile("images/0005.pgm", "no image");
  WriteFile("images/0007.pgm", FlatImage(1));
  WriteFile("times.txt", TimesText() + "0008 2000 1\n");
  const Recording recording = Read("");
  EXPECT_EQ(recording.frames.size(), 4U);
  EXPECT_EQ(recording.cameras[0].image_size, (ImageSize{16, 12}));
  std::map<std::string, std::string> reasons;
  for (const LeftOut& left : recording.left_out) reasons[left.frame] = left.reason;
  EXPECT_EQ(reasons.size(), 4U);
  EXPECT_EQ(reasons["0003"], "has 8 x 8 px, most have 16 x 12");
  EXPECT_THAT(reasons["0005"], HasSubstr("no image"));
  EXPECT_THAT(reasons["0007"], HasSubstr("has no time"));
  EXPECT_THAT(reasons["0008"], HasSubstr("no such image"));
  const RecordingSummary summary = Summarise(recording, CameraModels());
  EXPECT_THAT(SummaryText(recording, summary), HasSubstr("1 image, cam: has 8 x 8 px"));
}

TEST_F(Recordings, AreInTheOrderOfNumbers) {
  for (const int number : {1, 2, 9, 10, 11}) {
    WriteFile(fmt::format("cam/{}.pgm", number), FlatImage(number));
  }
  std::vector<std::string> names;
  for (const RecordedFrame& frame : Read("").frames) names.push_back(frame.name);
  EXPECT_THAT(names, ElementsAre("1", "2", "9", "10", "11"));
  const RecordingSummary summary = Summarise(Read(""), CameraModels());
  ASSERT_EQ(summary.cameras[0].gaps->size(), 1U);
  EXPECT_EQ(summary.cameras[0].gaps->front().missing, 6U);
}

TEST_F(Recordings, RefuseTimesThatDoNotFit) {
  WriteImages("images", 0);
  WriteFile("times.txt", "0001 1\n0002 2\n0003 1.5\n");
  EXPECT_THAT(Refusal(""), AllOf(HasSubstr("times.txt:3:6: time:"), HasSubstr("in line 2")));
  WriteFile("times.txt", "0001 1\n0002 two\n");
  EXPECT_THAT(Refusal(""), HasSubstr("times.txt:2:6: time: expected a number, found 'two'"));
  WriteFile("times.txt", "0001 1\n0002 2 1 1\n");
  EXPECT_THAT(Refusal(""), HasSubstr("times.txt:2: expected 3 columns (id,time,exposure)"));
  WriteFile("times.txt", "0001 1 -3\n");
  EXPECT_THAT(Refusal(""), HasSubstr("times.txt:1:8: exposure: expected a positive number"));
  WriteFile("times.txt", "0001 1\n1 2\n");
  EXPECT_THAT(Refusal(""), HasSubstr("times.txt:2: image '1' has a time in line 1 already"));
  WriteFile("times.txt", "100 1\n101 2\n");
  EXPECT_THAT(Refusal(""), HasSubstr("names no image of camera cam"));
  WriteFile("times.txt", "1\n2\n3\n");
  EXPECT_THAT(Refusal(""), HasSubstr("has 3 times, but camera cam has 6 images"));
  WriteFile("times.txt", "# nothing\n");
  EXPECT_THAT(Refusal(""), HasSubstr("holds no times"));
}

TEST_F(Recordings, WithoutTimesNeedEqualCountsOrTheUsersWord) {
  WriteImages("left", 0);
  WriteImages("right", 1);
  EXPECT_EQ(Read("").frames.size(), static_cast<size_t>(kFrames));
  fs::remove(Path("right/0003.pgm"));
  EXPECT_THAT(Refusal(""), HasSubstr("left has 6 images and right has 5"));
  WriteFile("recording.yaml",
            "plenocal: 1\ncameras: {left: {images: left}, right: {images: right}}\n"
            "pairing: {by: name}\n");
  const std::vector<Shown> shown = ShownBy(Read(""));
  ASSERT_EQ(shown.size(), static_cast<size_t>(kFrames));
  EXPECT_TRUE(std::isnan(shown[0].time));
  EXPECT_THAT(shown[2].grey, ElementsAre(GreyOf(0, 2), -1));
  WriteFile("recording.yaml",
            "plenocal: 1\ncameras: {left: {images: left}, right: {images: right}}\n"
            "pairing: {by: time}\n");
  EXPECT_THAT(Refusal(""), HasSubstr("camera left has no times"));
}

TEST_F(Recordings, RefuseMosaicsThatAreNotCalledSo) {
  for (int i = 0; i < kFrames; ++i) WriteFile(fmt::format("cam/{}.pgm", i), MosaicImage());
  EXPECT_THAT(Refusal(""), AllOf(HasSubstr("raw colour mosaics"), HasSubstr("bayer: RGGB")));
  WriteFile("recording.yaml", "plenocal: 1\ncameras: {cam: {images: cam, bayer: RGGB}}\n");
  EXPECT_EQ(Read("").cameras[0].bayer, BayerOrder::kRggb);
}

TEST_F(Recordings, TakeNoRampForAMosaic) {
  std::string ramp = "P5\n64 48\n255\n";
  for (int i = 0; i < 64 * 48; ++i) ramp += static_cast<char>(i % 64);
  WriteFile("cam/1.pgm", ramp);
  EXPECT_EQ(Read("").frames.size(), 1U);
}

TEST_F(Recordings, NameTheKeyThatIsWrong) {
  WriteImages("left", 0);
  const auto refusal = [&](const std::string& text) {
    WriteFile("recording.yaml", text);
    return Refusal("");
  };
  const std::string cameras = "plenocal: 1\ncameras: {left: {images: left}}\n";
  EXPECT_THAT(refusal("plenocal: 1\ncameras: {left: {image: left}}\n"),
              AllOf(HasSubstr("recording.yaml:2:"), HasSubstr("did you mean 'images'?")));
  EXPECT_THAT(refusal("plenocal: 1\ncameras: {left: {times: t.txt}}\n"), HasSubstr("images"));
  EXPECT_THAT(refusal("plenocal: 1\ncameras: {left: {images: left, times: t.txt}}\n"),
              AllOf(HasSubstr("recording.yaml:2:"), HasSubstr("t.txt: no such file")));
  EXPECT_THAT(refusal("plenocal: 1\ncameras: {left: {images: right/*.png}}\n"),
              HasSubstr("recording.yaml:2: cameras.left.images: no file matches"));
  EXPECT_THAT(refusal("plenocal: 1\n"), HasSubstr("cameras"));
  EXPECT_THAT(refusal(cameras + "pairing: {by: number}\n"), HasSubstr("unknown 'number'"));
  EXPECT_THAT(refusal(cameras + "pairing: {by: name, tolerance: 1}\n"), HasSubstr("tolerance"));
  EXPECT_THAT(refusal(cameras + "response: {lift: p.txt}\n"), HasSubstr("did you mean 'left'?"));
  EXPECT_THAT(refusal(cameras + "calibration: none.yaml\n"),
              AllOf(HasSubstr("recording.yaml:3:"), HasSubstr("no such file")));
  WriteFile("m.txt", "1 2 3\n");
  EXPECT_THAT(refusal(cameras + "markers: {left: {file: m.txt, columns: [frame, x, y]}}\n"),
              HasSubstr("'marker' is missing"));
  EXPECT_THAT(refusal("plenocal: 1\ncameras: {left: {images: left, bayer: RGB}}\n"),
              HasSubstr("RGGB"));
  EXPECT_THAT(refusal("plenocal: 1\ncameras: {left: {images: left, exposure_unit: m}}\n"),
              HasSubstr("exposure_unit"));
}

TEST_F(Recordings, RefuseDamagedArchives) {
  fs::create_directories(Path("tum"));
  WriteFile("tum/times.txt", TimesText());
  WriteFile("tum/images.zip", "PK no archive");
  EXPECT_THAT(Refusal("tum"), AllOf(HasSubstr("images.zip: is no zip archive")));
  std::map<std::string, std::string> files;
  for (int i = 0; i < kFrames; ++i) {
    std::string image = FlatImage(0, 64, 64);
    for (size_t k = image.size() - 4096; k < image.size(); ++k) {
      image[k] = static_cast<char>(k * k * (i + 1) >> 3);  // hardly packed, so that it can break
    }
    files[fmt::format("{:04}.pgm", i + 1)] = image;
  }
  WriteZip(Path("tum/images.zip"), files);
  std::string bytes = Workspace::Read("tum/images.zip");
  constexpr size_t kBefore = 60;  // the second file: in the content of the first
  bytes[bytes.find("PK\x03\x04", 4) - kBefore] ^= 0x55;
  Write("tum/images.zip", bytes);
  const Recording recording = Read("tum");
  EXPECT_EQ(recording.cameras[0].images.size(), static_cast<size_t>(kFrames - 1));
  ASSERT_EQ(recording.left_out.size(), 1U);
  EXPECT_THAT(recording.left_out[0].where, HasSubstr("images.zip/0001.pgm"));
  EXPECT_THAT(recording.left_out[0].reason, HasSubstr("damaged"));
  EXPECT_EQ(recording.cameras[0].Read(0).rows, 64);
}

TEST_F(Recordings, HaveNoFilesUnpackedThatAreTooLarge) {
  fs::create_directories(Path("tum"));
  WriteFile("tum/times.txt", TimesText());
  std::map<std::string, std::string> files;
  for (int i = 0; i < kFrames; ++i) files[fmt::format("{:04}.pgm", i + 1)] = FlatImage(0, 64, 64);
  WriteZip(Path("tum/images.zip"), files);
  std::string bytes = Workspace::Read("tum/images.zip");
  constexpr size_t kSize = 24;  // place in an entry of the archive's directory
  bytes.replace(bytes.find("PK\x01\x02") + kSize, 4, "\xff\xff\xff\x7f");
  Write("tum/images.zip", bytes);
  const Recording recording = Read("tum");
  ASSERT_EQ(recording.left_out.size(), 1U);
  EXPECT_THAT(recording.left_out[0].where, HasSubstr("images.zip/0001.pgm"));
  EXPECT_THAT(recording.left_out[0].reason, HasSubstr("larger than 960 MB"));
}

TEST_F(Recordings, GiveSuppliedMarkersAsDetections) {
  WriteImages("left", 0);
  const auto markers = [&](const std::string& keys, const std::string& text) {
    WriteFile("m.txt", text);
    WriteFile("recording.yaml",
              "plenocal: 1\ncameras: {left: {images: left}}\nmarkers: {left: {file: m.txt, " +
                  keys + "}}\n");
    return ReadSuppliedDetections(Read(""), 0);
  };
  const SuppliedDetections one =
      markers("columns: [frame, quality, marker, x, y], pixel_origin: 0.5, skip: 1",
              "a title, of words\n1 0.9 7 10.5 20\n0002.png 0.9 7 11 21\n99 0.9 7 0 0\n");
  EXPECT_EQ(one.csv, "frame,marker,x,y\n0001,7,10,19.5\n0002,7,10.5,20.5\n");
  EXPECT_EQ(one.points, 2U);
  EXPECT_EQ(one.left_out, 1U);
  EXPECT_EQ(one.first_left_out, 4);
  const SuppliedDetections two =
      markers("columns: [marker, y, x, frame, sigma]", "7,20,10,0001,0.1\n8,20,10,0001,\n");
  EXPECT_EQ(two.csv, "frame,marker,x,y,sigma\n0001,7,10,20,0.1\n0001,8,10,20,\n");
  EXPECT_THROW(markers("columns: [frame, marker, x, y]", "1 7 10 20\n0001 7 10 21\n"), Error);
  EXPECT_THROW(markers("columns: [frame, marker, x, y]", "1 7 10\n"), Error);
  EXPECT_THROW(markers("columns: [frame, marker, x, y]", "a 7 10 3\n"), Error);
}

TEST_F(Recordings, SayWhatCommandsLack) {
  WriteImages("images", 0);
  WriteFile("times.txt", TimesText());
  WriteFile("pcalib.txt", "0 1 2\n");
  WriteFile("camera.txt", "0.5 0.5 0.5 0.5 0\n16 12\ncrop\n16 12\n");
  const Recording recording = Read("");
  std::map<std::string, std::vector<std::string>> lacks;
  for (const CommandNeeds& needs : Summarise(recording, CameraModels()).needs) {
    lacks[needs.command] = needs.lacks;
  }
  ASSERT_EQ(lacks["vignette"].size(), 1U);
  EXPECT_THAT(lacks["vignette"][0], HasSubstr("camera.txt --format dso"));
  EXPECT_THAT(lacks["response"], ElementsAre(HasSubstr("differ")));
  EXPECT_EQ(lacks["groundtruth"].size(), 2U);
}

class RealRecordings : public ::testing::Test {
 protected:
  static fs::path Set(const std::string& name) { return OptionalData("scene_real/" + name); }
};

TEST_F(RealRecordings, OfAStereoPairAreFound) {
  struct Expected {
    const char* set;
    size_t frames;
  };
  for (const Expected& expected : {Expected{"stereo_loop_library", 346},
                                   Expected{"stereo_walk_backyard", 191},
                                   Expected{"stereo_calib_bumblebee2", 11}}) {
    if (!fs::exists(Set(expected.set))) GTEST_SKIP() << Absent(Set(expected.set));
    const Recording recording = ReadRecording(Set(expected.set));
    ASSERT_EQ(recording.cameras.size(), 2U) << expected.set;
    EXPECT_EQ(recording.cameras[0].name, "left");
    EXPECT_EQ(recording.cameras[1].name, "right");
    EXPECT_EQ(recording.frames.size(), expected.frames) << expected.set;
    const RecordingSummary summary = Summarise(recording, CameraModels());
    EXPECT_EQ(summary.complete, expected.frames) << expected.set;
    EXPECT_EQ(summary.cameras[0].Missing(), 0U) << expected.set;
    EXPECT_GT(recording.cameras[1].Read(recording.frames.size() - 1).cols, 300);
  }
}

TEST_F(RealRecordings, WithoutImagesAreRefused) {
  if (!fs::exists(Set("stereo_tracks_kitti"))) GTEST_SKIP() << Absent(Set("stereo_tracks_kitti"));
  EXPECT_THROW(static_cast<void>(ReadRecording(Set("stereo_tracks_kitti"))), Error);
}

// ---- the command

TEST_F(Recordings, ArePrintedByTheCommand) {
  WriteImages("set/left", 0);
  WriteImages("set/right", 1);
  WriteFile("set/times.txt", TimesText());
  const Outcome text = Run({"recording", "set"});
  ASSERT_EQ(text.status, kDone) << text.err;
  for (const char* part : {"set (folders)",
                           "left: 6 images, 16 x 12 px",
                           "6, 6 with images of all cameras (paired by time",
                           "0.500 s, 10 frames/s",
                           "left and right: 6 frames, times differ by 0 ms",
                           "2.5 to 2.5 ms, 0 changes",
                           "missing for"}) {
    EXPECT_THAT(text.out, HasSubstr(part));
  }
  const Outcome json = Run({"recording", "set", "--json", "--quiet"});
  ASSERT_EQ(json.status, kDone) << json.err;
  EXPECT_EQ(json.err, "");
  const YAML::Node node = YAML::Load(json.out);
  EXPECT_EQ(node["frames"].as<int>(), kFrames);
  EXPECT_EQ(node["cameras"]["right"]["images"].as<int>(), kFrames);
  EXPECT_NEAR(node["rate"].as<double>(), 1 / kInterval, 1e-6);
}

TEST_F(Recordings, AreRefusedByTheCommandInOneLine) {
  for (const std::vector<std::string>& arguments : {std::vector<std::string>{"recording", "none"},
                                                    {"recording", "."},
                                                    {"recording", ".", "--markers"},
                                                    {"recording", ".", "-o", "out"}}) {
    const Outcome outcome = Run(arguments);
    EXPECT_EQ(outcome.status, kWrongInput);
    EXPECT_EQ(Lines(outcome.err).size(), 1U) << outcome.err;
  }
}

TEST_F(Recordings, WriteMarkersByTheCommand) {
  WriteImages("left", 0);
  WriteFile("m.txt", "1 7 10 20\n");
  WriteFile("recording.yaml",
            "plenocal: 1\ncameras: {left: {images: left}}\n"
            "markers: {left: {file: m.txt, columns: [frame, marker, x, y]}}\n");
  const Outcome outcome = Run({"recording", "recording.yaml", "--markers", "-o", "out"});
  ASSERT_EQ(outcome.status, kDone) << outcome.err;
  EXPECT_EQ(Workspace::Read("out/detections_left.csv"), "frame,marker,x,y\n0001,7,10,20\n");
}

}  // namespace TEST_FILE
}  // namespace plenocal::testing
