// Emulates a network link between two sites: packets are delayed, lost, queued or dropped.
//
//   tessera_wide_area_link CONTROL
//
// Makes two network namespaces joined by two TUN devices, 10.9.0.1 in the first and 10.9.0.2 in the
// second, and carries packets between them in user space, which also works with kernels without
// netem. Prints the paths by which to enter them, /proc/PID/fd/N for each, and runs until it is
// killed; everything disappears with it. Needs root and /dev/net/tun. CONTROL: a mapped file of
// Control.
//
// A packet leaves the queue when the link has sent those before it, arrives delay_us later, and is
// dropped if more than 250 ms of others wait. Senders use Reno, which loss slows down most.
#include <arpa/inet.h>
#include <fcntl.h>
#include <linux/if_tun.h>
#include <net/if.h>
#include <poll.h>
#include <sched.h>
#include <sys/ioctl.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <deque>
#include <random>
#include <vector>

namespace {

using std::chrono::nanoseconds;
using Clock = std::chrono::steady_clock;

constexpr std::array<const char*, 2> kAddresses = {"10.9.0.1", "10.9.0.2"};
constexpr nanoseconds kLongestQueue = std::chrono::milliseconds(250);

/// Shared with the test: native 64-bit integers in this order, one struct per direction.
struct Control {
  // Written by the test.
  std::int64_t delay_us;    // one way
  std::int64_t loss_ppm;    // packets lost of a million
  std::int64_t bits_per_s;  // one way; 0: no limit
  std::int64_t is_cut;      // not 0: drops every packet without an error
  // Written by this program: numbers of packets.
  std::int64_t passed, lost, overflowed, cut;
};

void check(bool good, const char* what) {
  if (good) return;
  std::perror(what);
  std::exit(1);
}

void write_text(const char* path, const char* text) {
  const int file = ::open(path, O_WRONLY | O_CLOEXEC);
  check(file >= 0 && ::write(file, text, std::strlen(text)) > 0, path);
  ::close(file);
}

sockaddr address(const char* text) {
  sockaddr_in v4{};
  v4.sin_family = AF_INET;
  check(::inet_pton(AF_INET, text, &v4.sin_addr) == 1, text);
  sockaddr any{};
  std::memcpy(&any, &v4, sizeof any);
  return any;
}

void bring_up(int control, const char* name) {
  ifreq request{};
  std::strncpy(request.ifr_name, name, IFNAMSIZ - 1);
  check(::ioctl(control, SIOCGIFFLAGS, &request) == 0, "SIOCGIFFLAGS");
  request.ifr_flags = static_cast<short>(request.ifr_flags | IFF_UP | IFF_RUNNING);
  check(::ioctl(control, SIOCSIFFLAGS, &request) == 0, "SIOCSIFFLAGS");
}

/// One end of the link: a namespace and its device.
struct Site {
  int space = -1, device = -1;
};

Site make_site(const char* own, const char* other) {
  check(::unshare(CLONE_NEWNET) == 0, "unshare");
  Site site;
  site.space = ::open("/proc/thread-self/ns/net", O_RDONLY);  // others enter by it: no O_CLOEXEC
  site.device = ::open("/dev/net/tun", O_RDWR | O_NONBLOCK | O_CLOEXEC);
  check(site.space >= 0 && site.device >= 0, "/dev/net/tun");
  ifreq request{};
  std::strncpy(request.ifr_name, "line", IFNAMSIZ - 1);
  request.ifr_flags = IFF_TUN | IFF_NO_PI;
  check(::ioctl(site.device, TUNSETIFF, &request) == 0, "TUNSETIFF");
  const int control = ::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  request.ifr_addr = address(own);
  check(::ioctl(control, SIOCSIFADDR, &request) == 0, "SIOCSIFADDR");
  request.ifr_dstaddr = address(other);
  check(::ioctl(control, SIOCSIFDSTADDR, &request) == 0, "SIOCSIFDSTADDR");
  request.ifr_qlen = 10000;
  check(::ioctl(control, SIOCSIFTXQLEN, &request) == 0, "SIOCSIFTXQLEN");
  bring_up(control, "line");
  bring_up(control, "lo");
  ::close(control);
  write_text("/proc/sys/net/ipv4/tcp_congestion_control", "reno");
  return site;
}

/// Packets in flight in one direction.
class Direction {
 public:
  Direction(int from, int to, Control& control, unsigned seed)
      : from_(from), to_(to), control_(control), random_(seed) {}

  /// Reads the packets that were sent.
  void read(Clock::time_point now) {
    std::array<char, 65536> bytes;
    for (;;) {
      const ssize_t count = ::read(from_, bytes.data(), bytes.size());
      if (count <= 0) return;
      take({bytes.data(), bytes.data() + count}, now);
    }
  }

  /// Writes the packets that have arrived; returns when the next one does.
  Clock::time_point write(Clock::time_point now) {
    while (!queue_.empty() && queue_.front().due <= now) {
      const std::vector<char>& bytes = queue_.front().bytes;
      if (::write(to_, bytes.data(), bytes.size()) > 0) ++control_.passed;
      queue_.pop_front();
    }
    return queue_.empty() ? Clock::time_point::max() : queue_.front().due;
  }

 private:
  struct Packet {
    Clock::time_point due;
    std::vector<char> bytes;
  };

  void take(std::vector<char> bytes, Clock::time_point now) {
    if (control_.is_cut != 0) {
      ++control_.cut;
    } else if (std::uniform_int_distribution<std::int64_t>(0, 999'999)(random_) <
               control_.loss_ppm) {
      ++control_.lost;
    } else if (free_ - now > kLongestQueue) {
      ++control_.overflowed;
    } else {
      free_ = std::max(free_, now);
      if (control_.bits_per_s > 0) {
        const auto bits = static_cast<std::int64_t>(bytes.size()) * 8;
        free_ += nanoseconds(bits * 1'000'000'000 / control_.bits_per_s);
      }
      queue_.push_back({free_ + std::chrono::microseconds(control_.delay_us), std::move(bytes)});
    }
  }

  const int from_, to_;
  Control& control_;
  std::mt19937 random_;
  Clock::time_point free_;  // when the link has sent everything given to it
  std::deque<Packet> queue_;
};

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fprintf(stderr, "usage: tessera_wide_area_link CONTROL\n");
    return 2;
  }
  const int file = ::open(argv[1], O_RDWR | O_CLOEXEC);
  check(file >= 0, argv[1]);
  void* memory = ::mmap(nullptr, sizeof(Control), PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  check(memory != MAP_FAILED, "mmap");
  auto& control = *static_cast<Control*>(memory);
  const Site first = make_site(kAddresses[0], kAddresses[1]);
  const Site second = make_site(kAddresses[1], kAddresses[0]);
  std::printf("/proc/%d/fd/%d /proc/%d/fd/%d\n", ::getpid(), first.space, ::getpid(), second.space);
  std::fflush(stdout);

  std::array<Direction, 2> directions = {Direction(first.device, second.device, control, 1),
                                         Direction(second.device, first.device, control, 2)};
  std::array<pollfd, 2> ends = {pollfd{first.device, POLLIN, 0}, pollfd{second.device, POLLIN, 0}};
  for (;;) {
    const auto now = Clock::now();
    const auto next = std::min(directions[0].write(now), directions[1].write(now));
    const auto wait = std::clamp<nanoseconds>(next - now, nanoseconds(0), std::chrono::seconds(1));
    const timespec span = {wait.count() / 1'000'000'000, wait.count() % 1'000'000'000};
    if (::ppoll(ends.data(), ends.size(), &span, nullptr) < 0) return 1;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      if ((ends[i].revents & POLLIN) != 0) directions[i].read(Clock::now());
    }
  }
}
