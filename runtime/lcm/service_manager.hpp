// What systemd is told of the runtime, by sd_notify(3)'s protocol: that it runs, then that it goes on.
#pragma once

namespace crux {

/// A datagram to the socket that the environment names as NOTIFY_SOCKET; without one nothing happens.
class ServiceManager {
 public:
  ServiceManager();
  ~ServiceManager();
  ServiceManager(const ServiceManager&) = delete;
  ServiceManager& operator=(const ServiceManager&) = delete;

  /// Cycles have gone by since the last call. The first time: all nodes have answered, the service has started.
  void goes_on() noexcept;

 private:
  int fd_ = -1;
  bool started_ = false;
};

}  // namespace crux
