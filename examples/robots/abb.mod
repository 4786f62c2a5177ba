! SPDX-License-Identifier: Apache-2.0
! RAPID (PC Interface), for a task of its own: keeps the newest grasp in PERS variables; where grasp_status is 0, stop.
!     grasptrack track camera:0 --publish "tcp://0.0.0.0:5555?format=fixed&rate=20"
! A line is 80 characters, what a string holds. The columns are those of docs/files.md. Not run on a controller yet.
MODULE Grasp
  PERS num grasp_status := 0;
  PERS num grasp_age_ms := 0;
  PERS num grasp_points{4} := [0, 0, 0, 0];
  VAR socketdev link;
  VAR string line;

  PROC main()
    VAR num state;
    VAR bool right;
    grasp_status := 0;
    SocketClose link;
    SocketCreate link;
    SocketConnect link, "192.168.0.10", 5555 \Time:=2;
    WHILE TRUE DO
      SocketReceive link \Str:=line \ReadNoOfBytes:=80 \Time:=0.2;
      right := StrToVal(StrPart(line, 4, 1), state);
      right := right AND StrToVal(StrPart(line, 13, 6), grasp_age_ms);
      right := right AND StrToVal(StrPart(line, 27, 7), grasp_points{1});
      right := right AND StrToVal(StrPart(line, 35, 7), grasp_points{2});
      right := right AND StrToVal(StrPart(line, 43, 7), grasp_points{3});
      right := right AND StrToVal(StrPart(line, 51, 7), grasp_points{4});
      IF right THEN
        grasp_status := state;
      ELSE
        grasp_status := 0;
      ENDIF
    ENDWHILE
  ERROR
    ! No line within 0.2 s, or no connection: the other tasks see status 0, and this one connects anew.
    grasp_status := 0;
    WaitTime 0.5;
    ExitCycle;
  ENDPROC
ENDMODULE
