#include "worker/ipc/message_socket.h"

#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <utility>

#include "absl/strings/str_cat.h"

namespace tessera::agent {
namespace {

constexpr std::size_t kDescriptorsPerBatch = 200;  // the kernel takes at most 253

static_assert(std::endian::native == std::endian::little);

}  // namespace

void Descriptor::reset() {
  if (fd_ >= 0) ::close(std::exchange(fd_, -1));
}

absl::Status MessageSocket::send(const std::string& message, std::span<const int> descriptors) {
  if (message.size() > kMaxMessageBytes) {
    return absl::InvalidArgumentError(
        absl::StrCat("message of ", message.size(), " bytes exceeds the limit"));
  }
  const std::lock_guard lock(send_mutex_);
  const auto length = static_cast<std::uint32_t>(message.size());
  std::array<char, 4> prefix;
  std::memcpy(prefix.data(), &length, prefix.size());
  absl::Status status = write_all(prefix.data(), prefix.size());
  if (status.ok()) status = write_all(message.data(), message.size());
  while (status.ok() && !descriptors.empty()) {
    const std::size_t count = std::min(descriptors.size(), kDescriptorsPerBatch);
    status = send_batch(descriptors.first(count));
    descriptors = descriptors.subspan(count);
  }
  return status;
}

absl::StatusOr<std::optional<std::string>> MessageSocket::receive() {
  std::array<char, 4> prefix;
  auto received = read_all(prefix.data(), prefix.size());
  if (!received.ok()) return received.status();
  if (*received == 0) return std::nullopt;
  std::uint32_t length = 0;
  std::memcpy(&length, prefix.data(), prefix.size());
  if (*received < prefix.size() || length > kMaxMessageBytes) {
    return absl::DataLossError("invalid message length");
  }
  std::string message(length, '\0');
  received = read_all(message.data(), length);
  if (!received.ok()) return received.status();
  if (*received < length) return absl::DataLossError("connection closed within a message");
  return message;
}

absl::StatusOr<std::vector<Descriptor>> MessageSocket::receive_descriptors(std::size_t count) {
  std::vector<Descriptor> descriptors;
  while (descriptors.size() < count) {
    const std::size_t before = descriptors.size();
    if (absl::Status status = receive_batch(descriptors); !status.ok()) return status;
    if (descriptors.size() == before || descriptors.size() > count) {
      return absl::DataLossError("unexpected number of descriptors");
    }
  }
  return descriptors;
}

void MessageSocket::shut_down() {
  ::shutdown(socket_.get(), SHUT_RDWR);
}

absl::Status MessageSocket::write_all(const char* bytes, std::size_t count) {
  while (count > 0) {
    const ssize_t sent = ::send(socket_.get(), bytes, count, MSG_NOSIGNAL);
    if (sent < 0 && errno == EINTR) continue;
    if (sent < 0) return absl::UnavailableError(absl::StrCat("send: ", std::strerror(errno)));
    bytes += sent;
    count -= static_cast<std::size_t>(sent);
  }
  return absl::OkStatus();
}

absl::StatusOr<std::size_t> MessageSocket::read_all(char* bytes, std::size_t count) {
  std::size_t done = 0;
  while (done < count) {
    const ssize_t received = ::recv(socket_.get(), bytes + done, count - done, 0);
    if (received < 0 && errno == EINTR) continue;
    if (received < 0 && errno != ECONNRESET) {
      return absl::UnavailableError(absl::StrCat("recv: ", std::strerror(errno)));
    }
    if (received <= 0) break;
    done += static_cast<std::size_t>(received);
  }
  return done;
}

absl::Status MessageSocket::send_batch(std::span<const int> descriptors) {
  char mark = 'D';  // descriptors travel with at least one byte
  iovec data{&mark, 1};
  std::vector<char> control(CMSG_SPACE(descriptors.size_bytes()), 0);
  msghdr header{};
  header.msg_iov = &data;
  header.msg_iovlen = 1;
  header.msg_control = control.data();
  header.msg_controllen = control.size();
  cmsghdr* part = CMSG_FIRSTHDR(&header);
  part->cmsg_level = SOL_SOCKET;
  part->cmsg_type = SCM_RIGHTS;
  part->cmsg_len = CMSG_LEN(descriptors.size_bytes());
  std::memcpy(CMSG_DATA(part), descriptors.data(), descriptors.size_bytes());
  while (::sendmsg(socket_.get(), &header, MSG_NOSIGNAL) < 0) {
    if (errno == EINTR) continue;
    return absl::UnavailableError(absl::StrCat("sendmsg: ", std::strerror(errno)));
  }
  return absl::OkStatus();
}

absl::Status MessageSocket::receive_batch(std::vector<Descriptor>& out) {
  char mark = 0;
  iovec data{&mark, 1};
  std::vector<char> control(CMSG_SPACE(kDescriptorsPerBatch * sizeof(int)), 0);
  msghdr header{};
  header.msg_iov = &data;
  header.msg_iovlen = 1;
  header.msg_control = control.data();
  header.msg_controllen = control.size();
  ssize_t received = -1;
  do {
    received = ::recvmsg(socket_.get(), &header, MSG_CMSG_CLOEXEC);
  } while (received < 0 && errno == EINTR);
  if (received != 1) return absl::DataLossError("connection closed before the descriptors");
  for (cmsghdr* part = CMSG_FIRSTHDR(&header); part != nullptr; part = CMSG_NXTHDR(&header, part)) {
    if (part->cmsg_level != SOL_SOCKET || part->cmsg_type != SCM_RIGHTS) continue;
    const std::size_t count = (part->cmsg_len - CMSG_LEN(0)) / sizeof(int);
    for (std::size_t i = 0; i < count; ++i) {
      int fd = -1;
      std::memcpy(&fd, CMSG_DATA(part) + i * sizeof(int), sizeof fd);
      out.emplace_back(fd);
    }
  }
  return absl::OkStatus();
}

absl::StatusOr<std::pair<Descriptor, Descriptor>> socket_pair() {
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0) {
    return absl::InternalError(absl::StrCat("socketpair: ", std::strerror(errno)));
  }
  return std::pair(Descriptor(ends[0]), Descriptor(ends[1]));
}

}  // namespace tessera::agent
