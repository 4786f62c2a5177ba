# SPDX-License-Identifier: Apache-2.0
# docker build -t grasptrack . && docker run --rm -p 127.0.0.1:8321:8321 --device /dev/video0 grasptrack live camera:0 \
#   --host 0.0.0.0 --name localhost
# This prints the page's address with its token; without a command it says what there is.
FROM python:3.12-slim AS build
RUN apt-get update && apt-get install -y --no-install-recommends g++ && rm -rf /var/lib/apt/lists/*
COPY . /source
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels /source

FROM python:3.12-slim
COPY --from=build /wheels /wheels
RUN wheel=$(ls /wheels/*.whl) && pip install --no-cache-dir "$wheel[live,bags]" && rm -rf /wheels \
    && useradd --create-home --groups video user
USER user
WORKDIR /home/user
EXPOSE 8321
ENTRYPOINT ["grasptrack"]
CMD ["--help"]
