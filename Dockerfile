# Central command in a container: docker build -t swarm-gcs . && docker run --rm --network host swarm-gcs demo
# This file has not been built by the project's own checks.
FROM python:3.13-slim AS build
COPY requirements.lock /src/
RUN python -m venv /opt/swarm-gcs \
    && /opt/swarm-gcs/bin/pip install --no-cache-dir --require-hashes -r /src/requirements.lock
COPY . /src
RUN /opt/swarm-gcs/bin/pip install --no-cache-dir --no-deps /src

FROM python:3.13-slim
RUN useradd --create-home --groups dialout gcs \
    && install -d -o gcs -g gcs /flights /var/cache/swarm-gcs
COPY --from=build /opt/swarm-gcs /opt/swarm-gcs
# Kernels are compiled for the processor that runs them, at the first start: keep this folder in a volume.
ENV PATH=/opt/swarm-gcs/bin:$PATH NUMBA_CACHE_DIR=/var/cache/swarm-gcs
USER gcs
WORKDIR /flights
VOLUME ["/flights", "/var/cache/swarm-gcs"]
ENTRYPOINT ["gcs"]
CMD ["--help"]
