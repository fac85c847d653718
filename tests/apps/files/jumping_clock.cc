// SPDX-License-Identifier: Apache-2.0
//
// Preloaded into the program (LD_PRELOAD), makes the time of day jump at each call: forwards and
// backwards by up to a year.
#include <dlfcn.h>
#include <sys/time.h>

#include <atomic>
#include <ctime>

namespace {

time_t Jump() {
  constexpr unsigned kYear = 31556952;  // s
  static std::atomic<unsigned> random{1};
  random = 1664525 * random + 1013904223;
  return static_cast<time_t>(random % (2 * kYear)) - kYear;
}

}  // namespace

extern "C" {

int clock_gettime(clockid_t clock, timespec* now) noexcept {
  using Function = int(clockid_t, timespec*);
  static auto* const kReal = reinterpret_cast<Function*>(dlsym(RTLD_NEXT, "clock_gettime"));
  const int result = kReal(clock, now);
  if (clock == CLOCK_REALTIME) now->tv_sec += Jump();
  return result;
}

int gettimeofday(timeval* now, void*) noexcept {
  timespec exact{};
  const int result = clock_gettime(CLOCK_REALTIME, &exact);
  *now = {exact.tv_sec, exact.tv_nsec / 1000};
  return result;
}

time_t time(time_t* now) noexcept {
  timespec exact{};
  clock_gettime(CLOCK_REALTIME, &exact);
  if (now != nullptr) *now = exact.tv_sec;
  return exact.tv_sec;
}

}  // extern "C"
