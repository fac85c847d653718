# Plenocal in a container:
#   docker build -t plenocal .
#   docker run --rm -v "$PWD:/data" --user "$(id -u):$(id -g)" plenocal calibrate 'images/*.jpg' --target chessboard:9x6:25mm -o OUT
FROM debian:bookworm-slim AS build
COPY . /plenocal
WORKDIR /plenocal
RUN apt-get update && scripts/install_packages python3-venv python3-dev dpkg-dev file && PYTHON=/usr/bin/python3 scripts/deb

FROM debian:bookworm-slim
COPY --from=build /plenocal/build/deb/plenocal_*.deb /plenocal/build/deb/python3-plenocal_*.deb /tmp/
RUN apt-get update \
  && apt-get install -y --no-install-recommends /tmp/plenocal_*.deb /tmp/python3-plenocal_*.deb fonts-dejavu-core \
  && apt-get clean && rm -rf /var/lib/apt/lists/* /tmp/*.deb \
  && useradd --create-home plenocal
USER plenocal
WORKDIR /data
ENTRYPOINT ["plenocal"]
CMD ["--help"]
