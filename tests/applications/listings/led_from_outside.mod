MODULE LedFromOutside
    PERS tooldata tRoller:=[TRUE,[[12,-8,190],[1,0,0,0]],[4,[0,0,90],[1,0,0,0],0,0,0]];
    VAR egmident sensor;
    CONST egm_minmax near:=[-0.4,0.4];
    CONST robtarget pReady:=[[1480,220,1240],[0.5,0,0.866025,0],[0,0,0,0],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];
    CONST jointtarget jFold:=[[10,20,-10,5,60,20],[9E+09,9E+09,9E+09,9E+09,9E+09,9E+09]];

    PROC main()
        MoveAbsJ jFold\NoEOffs,v200,fine,tRoller;
        MoveL pReady,v100,fine,tRoller\WObj:=wobj0;
        EGMGetId sensor;
        EGMSetupUC ROB_1,sensor,"room","ROB_1:"\Pose;
        EGMActPose sensor\Tool:=tRoller,wobj0.uframe,EGM_FRAME_BASE,wobj0.uframe,EGM_FRAME_BASE\X:=near\Y:=near;
        EGMRunPose sensor,EGM_STOP_HOLD\X\Y\CondTime:=4\RampOutTime:=2;
        EGMReset sensor;
        leave pReady;
    ENDPROC

    PROC leave(robtarget pReady)
        MoveL pReady,v100,fine,tRoller\WObj:=wobj0;
    ENDPROC
ENDMODULE
