// SPDX-License-Identifier: Apache-2.0
//
// Calibrates a camera from images in memory: embed chessboard:9x6:25mm 1.jpg 2.jpg ...
#include <plenocal/engine.h>

#include <iostream>
#include <opencv2/imgcodecs.hpp>

int main(int argc, char** argv) {
  namespace api = plenocal::api;
  if (argc < 3) return 2;
  std::vector<cv::Mat> pixels;
  api::Source camera{.name = "left", .model = "pinhole-radtan4"};
  for (int i = 2; i < argc; ++i) {
    const cv::Mat& image = pixels.emplace_back(cv::imread(argv[i], cv::IMREAD_GRAYSCALE));
    camera.images.push_back({.frame = std::to_string(i),
                             .data = image.data,
                             .width = image.cols,
                             .height = image.rows,
                             .stride = image.step});
  }
  plenocal::Run run;
  run.listener.message = [](const std::string& line) { std::cerr << line << "\n"; };
  try {
    const api::Session session = api::Session::InMemory(argv[1], {camera});
    const api::Calibration result = api::CalibrateSession(session, {}, run);
    const api::Parameter f_x = result["left"].parameters()[0];
    std::cout << f_x.name << " = " << f_x.value << " +- " << f_x.sigma << " " << f_x.unit << "\n";
    const auto pixel = result["left"].Project({0.1, 0.05, 1.0});
    std::cout << "(0.1, 0.05, 1) m is imaged at " << (*pixel)[0] << ", " << (*pixel)[1] << " px\n";
    return result.grade == api::Grade::kBad ? 1 : 0;
  } catch (const plenocal::Error& error) {
    std::cerr << error.what() << "\n";
    return 1;
  }
}
